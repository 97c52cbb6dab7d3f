//! Constants of the world in canonical units: length LU, time TU, speed LU/TU.

/// Gravitational parameter of the Earth, LU³/TU².
pub const GM: f64 = 1000.0;
/// Radius of the Earth, LU. Bodies inside it are lost.
pub const EARTH_RADIUS: f64 = 20.0;
/// Combined hard-body radius, LU: bodies closer than this touch.
pub const CONTACT_DISTANCE: f64 = 2.0;
/// Number of satellites; each is an agent.
pub const SATELLITES: usize = 3;
/// Steps of 1 TU each after which an episode is truncated.
pub const HORIZON: u32 = 50;
/// Distance that every score keeps from 0 and 1.
pub const EPSILON: f64 = 1e-3;
/// Largest change of velocity per axis and step, LU/TU.
pub const MAX_BURN: f64 = 1.0;
/// Fuel units per LU/TU of velocity change.
pub const FUEL_PER_SPEED: f64 = 5.0;
/// Fragments that a destroyed satellite leaves.
pub const FRAGMENTS: usize = 2;
/// Radius at which rogue debris arrives, LU.
pub const ROGUE_RADIUS: f64 = 95.0;
/// Range of the initial radii of satellites, LU.
pub const SATELLITE_RADII: (f64, f64) = (50.0, 80.0);
/// Range of the initial radii of debris, LU.
pub const DEBRIS_RADII: (f64, f64) = (40.0, 90.0);
/// Target radius of the rendezvous task, LU.
pub const TARGET_RADIUS: f64 = 100.0;
/// Distance from the target radius at which proximity reaches zero, LU.
pub const PROXIMITY_WIDTH: f64 = 30.0;
/// Number of last steps over which the rendezvous goal is averaged.
pub const RENDEZVOUS_STEPS: u32 = 20;
/// Number of last steps over which the formation goal is averaged.
pub const FORMATION_STEPS: u32 = 25;
/// Mean proximity (or formation quality) over those steps from which an episode is a success.
pub const GOAL_THRESHOLD: f64 = 0.9;
/// Side of the formation triangle, LU.
pub const FORMATION_SIDE: f64 = 20.0;
/// Deviation of a pair's distance from the side at which its quality reaches zero, LU.
pub const FORMATION_WIDTH: f64 = 20.0;
/// Range of the initial radius of the formation's centre, LU.
pub const FORMATION_RADII: (f64, f64) = (55.0, 75.0);
/// Second zonal coefficient of the Earth's gravity field, dimensionless (WGS 84: C₂₀ =
/// −4.84165371736e-4, J₂ = −√5·C₂₀).
pub const J2: f64 = 1.082_626_68e-3;
/// Cumulative survival probability below which a satellite counts as lost under `risk: pc`.
pub const SURVIVAL_THRESHOLD: f64 = 0.9;
/// Radar range that hides nothing, LU (0 in telemetry).
pub const RADAR_NONE: f64 = 300.0;
/// Steps within which a fair start has no contact under hold.
pub const FAIR_STEPS: u32 = 2;
/// Maximum number of redraws of one body to make a start fair.
pub const FAIR_TRIES: u32 = 64;

/// Number of standard deviations beyond the contact distance after which the collision probability
/// underflows an f64.
pub(crate) const SIGMAS: f64 = 9.0;
/// Squared radius of the Earth, LU².
pub(crate) const EARTH_RADIUS_2: f64 = EARTH_RADIUS * EARTH_RADIUS;
/// Squared contact distance, LU².
pub(crate) const CONTACT_2: f64 = CONTACT_DISTANCE * CONTACT_DISTANCE;
/// 1.5·J₂·Re², LU². Divided by r² it is the relative increase of gravity in the equatorial plane
/// due to J₂.
pub(crate) const J2_PULL: f64 = 1.5 * J2 * EARTH_RADIUS_2;
