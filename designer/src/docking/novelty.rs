//! Distance of two designs, by their deputies. Names and the order of deputies do not matter.

use env_core::docking::relative_motion::{RelativeState, distance, relative_speed, speed_limit};

use super::design::{DeputyStart, DockingDesign};
use super::vocabulary::DISTANCE;
use crate::distance_parts::{mean_nearest, param_distance, root_mean_square};

/// Ratio of two distances at which deputies are unrelated.
const UNRELATED_RATIO: f64 = 8.0;
/// Angle of two directions at which deputies are unrelated, in degrees.
const UNRELATED_ANGLE_DEG: f64 = 120.0;
/// Difference of two velocities, divided by the mean speed limit, at which deputies are unrelated.
const UNRELATED_SPEEDS: f64 = 2.0;
/// Distance that another failure mode adds.
const MODE_DISTANCE: f64 = 0.1;

/// Returns the distance of two designs: the mean, over all deputies of both, of the distance to the nearest deputy of the other
/// design. It is 0 for equal deputies; 1 is about the distance of deputies that share nothing.
pub(super) fn design_distance(a: &DockingDesign, b: &DockingDesign) -> f64 {
    let deputies = mean_nearest(&a.deputies, &b.deputies, deputy_distance);
    let mode = if a.aim.mode == b.aim.mode { 0.0 } else { MODE_DISTANCE };
    (deputies + param_distance(&a.params, &b.params) + mode).min(1.0)
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
    root_mean_square(&differences.map(|part| part.min(1.0)))
}
