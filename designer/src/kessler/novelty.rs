//! Distance of two designs, by their encounters. Names and the order of encounters do not matter.

use super::design::{Design, Encounter};
use super::placement::angle_between;
use super::vocabulary::{Bound, MISS, SPEED, STEP};

/// Difference of two encounters in a property that is not a number: satellite, kind, rogue or not.
const CATEGORY_DIFFERENCE: f64 = 0.5;

/// Distance that each differing param adds: another fuel is another situation, but nearly the same layout.
const PARAM_DISTANCE: f64 = 0.03;

/// Returns the distance of two designs: the mean, over all encounters of both, of the distance to the nearest encounter of the
/// other design. It is 0 for equal encounters; 1 is about the distance of encounters that share nothing.
pub(super) fn distance(a: &Design, b: &Design) -> f64 {
    if a.encounters.is_empty() || b.encounters.is_empty() {
        return 1.0;
    }
    let same_frame = a.frame == b.frame;
    let nearest = |of: &Encounter, among: &Design| {
        among
            .encounters
            .iter()
            .map(|other| encounter_distance(of, other, same_frame))
            .fold(f64::MAX, f64::min)
    };
    let all = a.encounters.iter().map(|e| nearest(e, b)).chain(b.encounters.iter().map(|e| nearest(e, a)));
    let count = a.encounters.len() + b.encounters.len();
    let changed_params = a.params.iter().filter(|(name, value)| b.params.get(*name) != Some(value)).count()
        + b.params.keys().filter(|name| !a.params.contains_key(*name)).count();
    (all.sum::<f64>() / count as f64 + PARAM_DISTANCE * changed_params as f64).min(1.0)
}

/// Returns the root mean square of the differences of two encounters, each on the scale of its bounds. Bearings in different
/// frames cannot be compared.
fn encounter_distance(a: &Encounter, b: &Encounter, same_frame: bool) -> f64 {
    let scaled = |bound: Bound, a: u32, b: u32| f64::from(a.abs_diff(b)) / f64::from(bound.max - bound.min);
    let turn = angle_between(f64::from(a.bearing_deg), f64::from(b.bearing_deg)).abs() / 180.0;
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
    let sum_of_squares = differences.iter().map(|difference| difference * difference).sum::<f64>();
    (sum_of_squares / differences.len() as f64).sqrt()
}
