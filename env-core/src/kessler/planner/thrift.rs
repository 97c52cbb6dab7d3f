//! Under `risk: pc` every passage costs a little, so that almost any burn moves the score a little. What it moves by less
//! than counts is no reason to burn: the reference holds wherever holding does as well.

use super::table::{Burn, Path, Table};
use crate::bracket::Flown;
use crate::kessler::constants::{EPSILON, GOAL, SATELLITES};

/// `paths` without the burns that gain nothing, and how they then fare: first whole satellites are held, then single
/// burns are left out, the last first. All that is left out together costs less than the world's ε of score, what the
/// critique counts as no difference, loses nobody, and fails no goal that was met.
pub(super) fn spare(
    table: &Table,
    holds: [&Path; SATELLITES],
    paths: [&Path; SATELLITES],
    flown: Flown,
    judged: impl Fn([&Path; SATELLITES]) -> Flown,
) -> (Flown, [Path; SATELLITES]) {
    let mut kept = paths.map(Path::clone);
    let mut best = flown;
    let mut take_if_as_good = |kept: &mut [Path; SATELLITES], satellite: usize, other: &Path| {
        let tried = std::array::from_fn(|i| if i == satellite { other } else { &kept[i] });
        let found = judged(tried);
        let good = as_good(&found, &flown);
        if good {
            best = found;
            kept[satellite].clone_from(other);
        }
        good
    };
    for satellite in 0..SATELLITES {
        if !kept[satellite].burns.is_empty() {
            take_if_as_good(&mut kept, satellite, holds[satellite]);
        }
    }
    let mut path = holds[0].clone();
    for satellite in 0..SATELLITES {
        for at in (0..kept[satellite].burns.len()).rev() {
            let mut burns: Vec<Burn> = kept[satellite].burns.clone();
            let first = burns.remove(at).step;
            path.branch(&kept[satellite], first);
            path.fly(table, first, &burns[at..]);
            take_if_as_good(&mut kept, satellite, &path);
        }
    }
    (best, kept)
}

fn as_good(found: &Flown, wanted: &Flown) -> bool {
    let met = |flown: &Flown| flown.goal.is_none_or(|goal| goal >= GOAL);
    found.score > wanted.score - EPSILON && found.lost <= wanted.lost && (met(found) || !met(wanted))
}
