//! How different two designs are: by what is met, from where, when, how fast and how close; not by names or order.

use super::language::{BEARING, Bound, Design, Encounter, MISS, SPEED, STEP};
use super::place::difference;

/// Weight of what is not a number: another satellite, another kind, a rogue instead of debris.
const OTHER: f64 = 0.5;

/// The distance of two designs: the mean, over all encounters of both, of how far the nearest encounter of the other is.
/// 0 for the same encounters in whatever order; 1 is about as far as two encounters can be that share nothing.
#[must_use]
pub fn distance(a: &Design, b: &Design) -> f64 {
    let nearest = |of: &Encounter, among: &Design| {
        among.encounters.iter().map(|other| apart(of, other)).fold(f64::MAX, f64::min)
    };
    let all = a.encounters.iter().map(|e| nearest(e, b)).chain(b.encounters.iter().map(|e| nearest(e, a)));
    let count = a.encounters.len() + b.encounters.len();
    if a.encounters.is_empty() || b.encounters.is_empty() { 1.0 } else { all.sum::<f64>() / count as f64 }
}

/// How far apart two encounters are: the root of the mean square of their differences, each on the scale of its bounds.
fn apart(a: &Encounter, b: &Encounter) -> f64 {
    let share = |bound: Bound, a: u32, b: u32| f64::from(a.abs_diff(b)) / f64::from(bound.max - bound.min);
    let turn = difference(f64::from(a.bearing_deg), f64::from(b.bearing_deg)).abs() / 180.0;
    let word = |differ: bool| if differ { OTHER } else { 0.0 };
    let parts = [
        share(STEP, a.step, b.step),
        turn * f64::from(BEARING.max) / 359.0,
        share(SPEED, a.relative_speed, b.relative_speed),
        share(MISS, a.miss_distance, b.miss_distance),
        word(a.satellite != b.satellite),
        word(a.kind != b.kind),
        word(a.rogue != b.rogue),
    ];
    (parts.iter().map(|part| part * part).sum::<f64>() / parts.len() as f64).sqrt()
}
