//! The numbers of the world, in canonical units: length LU, time TU, speed LU/TU. Once, here.

/// Gravitational parameter, LU³/TU².
pub const GM: f64 = 1000.0;
/// Inside this radius, LU, a body is lost.
pub const EARTH_RADIUS: f64 = 20.0;
/// Bodies closer than this, LU, touch.
pub const CONTACT_DISTANCE: f64 = 2.0;
/// Satellites, each an agent.
pub const SATELLITES: usize = 3;
/// Steps, of 1 TU each, after which an episode is truncated.
pub const HORIZON: u32 = 50;
/// What a score keeps away from 0 and 1.
pub const EPSILON: f64 = 1e-3;
/// Largest change of speed per axis and step, LU/TU.
pub const MAX_BURN: f64 = 1.0;
/// Fuel units per LU/TU.
pub const FUEL_PER_SPEED: f64 = 5.0;
/// Fragments of a satellite that is hit.
pub const FRAGMENTS: usize = 2;
/// Radius at which rogue debris arrives, LU.
pub const ROGUE_RADIUS: f64 = 95.0;
/// Start radii of satellites, LU.
pub const SATELLITE_RADII: (f64, f64) = (50.0, 80.0);
/// Start radii of debris, LU.
pub const DEBRIS_RADII: (f64, f64) = (40.0, 90.0);
/// The radius that rendezvous asks for, LU.
pub const TARGET_RADIUS: f64 = 100.0;
/// Distance from the target radius at which proximity is zero, LU.
pub const PROXIMITY_WIDTH: f64 = 30.0;
/// Steps at the end over which rendezvous is judged.
pub const RENDEZVOUS_STEPS: u32 = 20;
/// Steps at the end over which formation is judged.
pub const FORMATION_STEPS: u32 = 25;
/// Mean proximity, or mean form, over them that counts as a success.
pub const GOAL: f64 = 0.9;
/// The side of the formation, LU.
pub const FORMATION_SIDE: f64 = 20.0;
/// How far a pair may be from that distance, LU, before its form is zero.
pub const FORMATION_WIDTH: f64 = 20.0;
/// Radii at which the centre of a formation starts, LU.
pub const FORMATION_RADII: (f64, f64) = (55.0, 75.0);
/// Second zonal coefficient of the Earth's field, a pure number (WGS 84: C₂₀ = −4.84165371736e-4, J₂ = −√5·C₂₀).
pub const J2: f64 = 1.082_626_68e-3;
/// Cumulative probability of survival below which, under `risk: pc`, a satellite counts as lost.
pub const SURVIVED: f64 = 0.9;
/// Radar range that sees everything, LU (0 on the wire).
pub const RADAR_NONE: f64 = 300.0;
/// Steps before which no fair start has a contact under hold.
pub const FAIR_STEPS: u32 = 2;
/// Tries at a fair start for one body.
pub const FAIR_TRIES: u32 = 64;

/// Miss distances beyond contact distance plus so many standard deviations have no probability that an f64 could hold.
pub(crate) const SIGMAS: f64 = 9.0;
pub(crate) const EARTH_RADIUS_2: f64 = EARTH_RADIUS * EARTH_RADIUS;
pub(crate) const CONTACT_2: f64 = CONTACT_DISTANCE * CONTACT_DISTANCE;
/// 1.5·J₂·Re², LU²: what J₂ adds to the pull in the equatorial plane, over r².
pub(crate) const J2_PULL: f64 = 1.5 * J2 * EARTH_RADIUS_2;
