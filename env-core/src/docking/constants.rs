//! The numbers of the world, in SI units. Once, here. They are those of safe-autonomy-sims' multi-agent docking, which
//! `docs/docking.md` cites.

/// Mean motion of the chief's circular orbit, rad/s (Dunlap et al. 2023, "Run Time Assured Reinforcement Learning for
/// Safe Satellite Docking", Journal of Aerospace Information Systems 20(1)).
pub const MEAN_MOTION_RAD_S: f64 = 0.001_027;
/// Mass of a deputy, kg.
pub const MASS_KG: f64 = 12.0;
/// Largest thrust per axis, N; the param `thrust_bound` lowers it.
pub const MAX_THRUST_N: f64 = 1.0;
/// One step, s.
pub const STEP_S: f64 = 1.0;
/// Most deputies there are.
pub const MAX_DEPUTIES: usize = 5;
/// Values of a deputy's state: x, y, z in m and vx, vy, vz in m/s of Hill's frame: x radial out, y in-track, z
/// cross-track.
pub const STATE: usize = 6;
/// Values of an observation.
pub const OBSERVATION: usize = 8;
/// Within this distance of the chief, m, a deputy docks or crashes.
pub const DOCKING_RADIUS_M: f64 = 0.5;
/// Speed limit at the docking radius and inside it, m/s.
pub const DOCKING_SPEED_M_S: f64 = 0.2;
/// What the speed limit grows by per metre beyond the docking radius, 1/s: twice the mean motion (Dunlap et al.
/// 2023, the same paper).
pub const LIMIT_SLOPE_1_S: f64 = 2.0 * MEAN_MOTION_RAD_S;
/// Beyond this distance of the chief, m, a deputy is lost.
pub const MAX_DISTANCE_M: f64 = 10_000.0;
/// Two deputies closer than this, m, collide.
pub const COLLISION_DISTANCE_M: f64 = 0.5;
/// Deputies start at least this far apart, m.
pub const START_SEPARATION_M: f64 = 1.0;
/// Tries at a start of one deputy that is far enough from the others.
pub const START_TRIES: u32 = 64;
/// Start distances lie between two thirds of `start_radius` and all of it: 100 to 150 m by default.
pub const INNER_RATIO: f64 = 2.0 / 3.0;
/// Azimuths at the start lie between 0 and this, rad, as in the original.
#[expect(clippy::approx_constant, reason = "the original's own number, not a full turn")]
pub const START_AZIMUTH_RAD: f64 = 6.283;
/// Elevations at the start lie between minus and plus this, rad, as in the original.
pub const START_ELEVATION_RAD: f64 = 1.57;
/// The time limit of the original, s, and the largest there is.
pub const TIME_LIMIT_S: f64 = 2000.0;
/// A deputy whose velocity reward adds up to this or less is stopped.
pub const SATURATION: f64 = -5.0;

/// Scale of the reward for coming nearer.
pub const DISTANCE_SCALE: f64 = 2.0;
/// Its decay, 1/m: it halves every 100 m.
pub const DISTANCE_DECAY_1_M: f64 = std::f64::consts::LN_2 / 100.0;
/// What a change of velocity costs, per m/s.
pub const DELTA_V_COST: f64 = 0.01;
/// What violating the speed limit costs: this per m/s beyond it, and this again.
pub const VIOLATION_COST: f64 = 0.01;
/// Reward for docking; up to as much again for docking early.
pub const SUCCESS: f64 = 1.0;
/// Reward for a timeout, leaving bounds or a crash.
pub const FAILURE: f64 = -1.0;

/// What positions are divided by in an observation, m.
pub const POSITION_SCALE_M: f64 = 100.0;
/// What velocities are divided by in an observation, m/s.
pub const VELOCITY_SCALE_M_S: f64 = 0.5;
