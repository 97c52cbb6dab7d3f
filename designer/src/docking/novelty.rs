//! Distance of two designs, by their deputies. Names and the order of deputies do not matter.

use env_core::docking::relative_motion::{RelativeState, distance, relative_speed, speed_limit};

use super::design::{DeputyStart, DockingDesign};
use super::vocabulary::DISTANCE;

/// Ratio of two distances at which deputies are unrelated.
const UNRELATED_RATIO: f64 = 8.0;
/// Angle of two directions at which deputies are unrelated, in degrees.
const UNRELATED_ANGLE_DEG: f64 = 120.0;
/// Difference of two velocities, divided by the mean speed limit, at which deputies are unrelated.
const UNRELATED_SPEEDS: f64 = 2.0;
/// Distance that each differing param adds: another time limit is another situation, but nearly the same layout.
const PARAM_DISTANCE: f64 = 0.03;
/// Distance that another failure mode adds.
const MODE_DISTANCE: f64 = 0.1;

/// Returns the distance of two designs: the mean, over all deputies of both, of the distance to the nearest deputy of the other
/// design. It is 0 for equal deputies; 1 is about the distance of deputies that share nothing.
pub(super) fn design_distance(a: &DockingDesign, b: &DockingDesign) -> f64 {
    if a.deputies.is_empty() || b.deputies.is_empty() {
        return 1.0;
    }
    let nearest = |of: &DeputyStart, among: &DockingDesign| {
        among.deputies.iter().map(|other| deputy_distance(of, other)).fold(f64::MAX, f64::min)
    };
    let all = a.deputies.iter().map(|deputy| nearest(deputy, b));
    let all = all.chain(b.deputies.iter().map(|deputy| nearest(deputy, a)));
    let count = a.deputies.len() + b.deputies.len();
    let changed_params = a.params.iter().filter(|(name, value)| b.params.get(*name) != Some(value)).count()
        + b.params.keys().filter(|name| !a.params.contains_key(*name)).count();
    let mode = if a.aim.mode == b.aim.mode { 0.0 } else { MODE_DISTANCE };
    (all.sum::<f64>() / count as f64 + PARAM_DISTANCE * changed_params as f64 + mode).min(1.0)
}

/// Returns the root mean square of the differences of two deputies in distance, direction and velocity. Velocities are compared
/// after the second one is turned to the direction of the first, and relative to the speed limit.
fn deputy_distance(a: &DeputyStart, b: &DeputyStart) -> f64 {
    let ratio = DISTANCE.value(a.distance) / DISTANCE.value(b.distance);
    let turned = DeputyStart { azimuth_deg: a.azimuth_deg, elevation_deg: a.elevation_deg, ..*b };
    let scaled = |deputy: &DeputyStart| {
        let state: RelativeState = deputy.state();
        let limit = speed_limit(distance(&state));
        state.map(|value| value / limit)
    };
    let differences = [
        libm::log(ratio).abs() / libm::log(UNRELATED_RATIO),
        a.direction_angle_deg(b) / UNRELATED_ANGLE_DEG,
        relative_speed(&scaled(a), &scaled(&turned)) / UNRELATED_SPEEDS,
    ];
    let sum_of_squares: f64 = differences.iter().map(|part| part.min(1.0) * part.min(1.0)).sum();
    (sum_of_squares / differences.len() as f64).sqrt()
}
