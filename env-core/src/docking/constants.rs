//! Constants of the world in SI units. They equal those of safe-autonomy-sims' multi-agent docking, which
//! `docs/worlds/docking.md` cites.

/// Mean motion of the chief's circular orbit, rad/s (Dunlap et al. 2023, "Run Time Assured Reinforcement Learning for
/// Safe Satellite Docking", Journal of Aerospace Information Systems 20(1)).
pub const MEAN_MOTION_RAD_S: f64 = 0.001_027;
/// Mass of a deputy, kg.
pub const MASS_KG: f64 = 12.0;
/// Largest thrust per axis, N; the param `thrust_bound` lowers it.
pub const MAX_THRUST_N: f64 = 1.0;
/// Duration of a step, s.
pub const STEP_S: f64 = 1.0;
/// Largest number of deputies.
pub const MAX_DEPUTIES: usize = 5;
/// Number of values of a deputy's state: x, y, z in m and vx, vy, vz in m/s in Hill's frame, with x radial out, y in-track
/// and z cross-track.
pub const STATE_DIM: usize = 6;
/// Number of values of a deputy's observation.
pub const OBSERVATION_DIM: usize = 8;
/// Distance from the chief within which a deputy docks or crashes, m.
pub const DOCKING_RADIUS_M: f64 = 0.5;
/// Speed limit at the docking radius and inside it, m/s.
pub const DOCKING_SPEED_M_S: f64 = 0.2;
/// Slope of the speed limit beyond the docking radius, 1/s: twice the mean motion (Dunlap et al. 2023, the same paper).
pub const LIMIT_SLOPE_1_S: f64 = 2.0 * MEAN_MOTION_RAD_S;
/// Distance from the chief beyond which a deputy is out of bounds, m.
pub const MAX_DISTANCE_M: f64 = 10_000.0;
/// Distance below which two deputies collide, m.
pub const COLLISION_DISTANCE_M: f64 = 0.5;
/// Smallest distance between two deputies at the start, m.
pub const START_SEPARATION_M: f64 = 1.0;
/// Number of redraws of a deputy's start that is too close to another.
pub const START_TRIES: u32 = 64;
/// Smallest start distance divided by `start_radius`: deputies start 100 to 150 m from the chief by default.
pub const MIN_START_RATIO: f64 = 2.0 / 3.0;
/// Smallest start distance of a scaled start, m: just outside the docking radius.
pub const MIN_START_DISTANCE_M: f64 = 0.8;
/// Distance by which scaled starts grow from one deputy to the next, m: six seconds at the docking speed, so that deputies do not
/// arrive together.
pub const START_STAGGER_M: f64 = 1.2;
/// Time for each metre of a scaled start, s/m.
pub const SCALED_TIME_S_PER_M: f64 = 10.0;
/// Smallest time limit of a scaled start, s, unless the recipe's is shorter.
pub const MIN_SCALED_TIME_S: f64 = 40.0;
/// Initial speeds shrink below a start scale of the inverse of this.
pub const SPEED_SCALE_RATIO: f64 = 4.0;
/// Largest azimuth at the start, rad, as in the original; the smallest is 0.
#[expect(clippy::approx_constant, reason = "the original's own number, not a full turn")]
pub const START_AZIMUTH_RAD: f64 = 6.283;
/// Largest magnitude of the elevation at the start, rad, as in the original.
pub const START_ELEVATION_RAD: f64 = 1.57;
/// Time limit of the original and largest time limit, s.
pub const TIME_LIMIT_S: f64 = 2000.0;
/// Sum of velocity rewards at or below which a deputy is stopped.
pub const MIN_VELOCITY_PENALTY: f64 = -5.0;

/// Scale of the reward for approaching the chief.
pub const DISTANCE_SCALE: f64 = 2.0;
/// Decay of proximity with distance, 1/m: it halves every 100 m.
pub const DISTANCE_DECAY_1_M: f64 = std::f64::consts::LN_2 / 100.0;
/// Cost of a change of velocity, per m/s.
pub const DELTA_V_COST: f64 = 0.01;
/// Cost of violating the speed limit: once, and again for each m/s above it.
pub const VIOLATION_COST: f64 = 0.01;
/// Reward for docking, without the bonus for docking early, which is at most as large.
pub const SUCCESS_REWARD: f64 = 1.0;
/// Reward for a timeout, leaving bounds or a crash.
pub const FAILURE_REWARD: f64 = -1.0;

/// Number of values of a deputy's extended observation.
pub const EXTENDED_DIM: usize = OBSERVATION_DIM + 12;
/// Divisor of the time that is left in an extended observation, s.
pub const TIME_SCALE_S: f64 = 500.0;
/// Divisor of positions in an observation, m.
pub const POSITION_SCALE_M: f64 = 100.0;
/// Divisor of velocities in an observation, m/s.
pub const VELOCITY_SCALE_M_S: f64 = 0.5;
