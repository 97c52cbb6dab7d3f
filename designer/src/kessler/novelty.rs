//! Distance of two designs, by their encounters. Names and the order of encounters do not matter.

use super::design::{Design, Encounter};
use super::vocabulary::{MISS, SPEED, STEP};
use crate::angles::angle_between;
use crate::bound::Bound;
use crate::distance_parts::{mean_nearest, param_distance, root_mean_square};

/// Difference of two encounters in a property that is not a number: satellite, kind, rogue or not.
const CATEGORY_DIFFERENCE: f64 = 0.5;

/// Returns the distance of two designs: the mean, over all encounters of both, of the distance to the nearest encounter of the
/// other design. It is 0 for equal encounters; 1 is about the distance of encounters that share nothing.
pub(super) fn distance(a: &Design, b: &Design) -> f64 {
    let same_frame = a.frame == b.frame;
    let of_encounters = |a: &Encounter, b: &Encounter| encounter_distance(a, b, same_frame);
    (mean_nearest(&a.encounters, &b.encounters, of_encounters) + param_distance(&a.params, &b.params))
        .min(1.0)
}

/// Returns the root mean square of the differences of two encounters, each on the scale of its bounds. Bearings in different
/// frames cannot be compared.
fn encounter_distance(a: &Encounter, b: &Encounter, same_frame: bool) -> f64 {
    let scaled =
        |bound: Bound<u32>, a: u32, b: u32| f64::from(a.abs_diff(b)) / f64::from(bound.max - bound.min);
    let turn = angle_between(f64::from(a.bearing_deg), f64::from(b.bearing_deg)) / 180.0;
    let bearing = if same_frame { turn } else { CATEGORY_DIFFERENCE };
    let category = |differs: bool| if differs { CATEGORY_DIFFERENCE } else { 0.0 };
    let differences = [
        scaled(STEP, a.step, b.step),
        bearing,
        scaled(SPEED, a.relative_speed, b.relative_speed),
        scaled(MISS, a.miss_distance, b.miss_distance),
        category(a.satellite != b.satellite),
        category(a.kind != b.kind),
        category(a.is_rogue != b.is_rogue),
    ];
    root_mean_square(&differences)
}
