//! How different two designs are: by what is met, from where, when, how fast and how close; not by names or order.

use super::language::{Bound, Design, Encounter, MISS, SPEED, STEP};
use super::place::difference;

/// Weight of what is not a number: another satellite, another kind, a rogue instead of debris.
const OTHER: f64 = 0.5;

/// What a param that differs adds: another fuel is another situation, and not quite another layout.
const PARAM: f64 = 0.03;

/// The distance of two designs: the mean, over all encounters of both, of how far the nearest encounter of the other is.
/// 0 for the same encounters in whatever order; 1 is about as far as two encounters can be that share nothing.
#[must_use]
pub fn distance(a: &Design, b: &Design) -> f64 {
    let turned = a.frame != b.frame;
    let nearest = |of: &Encounter, among: &Design| {
        among.encounters.iter().map(|other| apart(of, other, turned)).fold(f64::MAX, f64::min)
    };
    let all = a.encounters.iter().map(|e| nearest(e, b)).chain(b.encounters.iter().map(|e| nearest(e, a)));
    let count = a.encounters.len() + b.encounters.len();
    if a.encounters.is_empty() || b.encounters.is_empty() {
        return 1.0;
    }
    let changed = a.params.iter().filter(|(name, value)| b.params.get(*name) != Some(value)).count()
        + b.params.keys().filter(|name| !a.params.contains_key(*name)).count();
    (all.sum::<f64>() / count as f64 + PARAM * changed as f64).min(1.0)
}

/// How far apart two encounters are: the root of the mean square of their differences, each on the scale of its bounds.
/// A bearing in one frame is none in the other.
fn apart(a: &Encounter, b: &Encounter, turned: bool) -> f64 {
    let share = |bound: Bound, a: u32, b: u32| f64::from(a.abs_diff(b)) / f64::from(bound.max - bound.min);
    let turn = difference(f64::from(a.bearing_deg), f64::from(b.bearing_deg)).abs() / 180.0;
    let turn = if turned { OTHER } else { turn };
    let word = |differ: bool| if differ { OTHER } else { 0.0 };
    let parts = [
        share(STEP, a.step, b.step),
        turn,
        share(SPEED, a.relative_speed, b.relative_speed),
        share(MISS, a.miss_distance, b.miss_distance),
        word(a.satellite != b.satellite),
        word(a.kind != b.kind),
        word(a.rogue != b.rogue),
    ];
    (parts.iter().map(|part| part * part).sum::<f64>() / parts.len() as f64).sqrt()
}
