//! What each burn was worth: the same episode without it, everything else that the log asks for the same.

use std::cmp::Ordering;

use super::COUNTS;
use super::plans::{Fate, Plans};
use super::trace::Trace;
use crate::critique::{ActionVerdict, Verdict};
use crate::kessler::constants::{GOAL, SATELLITES};

/// A verdict on every burn that was applied, in order of step. What one satellite burns in one step is one burn.
pub(super) fn all(plans: &Plans<'_>, trace: &Trace) -> Vec<ActionVerdict> {
    let with = plans.as_flown();
    let mut path = plans.paths[0].clone();
    let mut verdicts = Vec::new();
    for satellite in 0..SATELLITES {
        for step in 1..=with.flown.steps {
            let cost = plans.paths[satellite].cost[step as usize];
            // A path goes on where a fragment took the satellite; and a burn of nothing is none.
            if !trace.satellite(satellite, step - 1).active() || cost <= 0.0 {
                continue;
            }
            plans.without(satellite, step, &mut path);
            let without = plans.with(satellite, &path);
            verdicts.push(ActionVerdict {
                step,
                agent: satellite as u32,
                cost,
                verdict: verdict(&with, &without),
                gain: with.flown.score - without.flown.score,
            });
        }
    }
    verdicts.sort_by_key(|v| (v.step, v.agent));
    verdicts
}

/// Losses speak first, then the goal, then how long satellites lived, then score.
fn verdict(with: &Fate, without: &Fate) -> Verdict {
    let gain = with.flown.score - without.flown.score;
    let met = |fate: &Fate| fate.flown.goal.is_some_and(|goal| goal >= GOAL);
    match with.flown.lost.cmp(&without.flown.lost) {
        Ordering::Less => return Verdict::Needed,
        Ordering::Greater => return Verdict::Harmful,
        Ordering::Equal => {}
    }
    if met(with) && !met(without) {
        Verdict::Needed
    } else if met(without) && !met(with) {
        Verdict::Harmful
    } else if gain > COUNTS {
        Verdict::Needed
    } else if gain < -COUNTS {
        if with.lived() < without.lived() { Verdict::Harmful } else { Verdict::Wasteful }
    } else {
        Verdict::Harmless
    }
}
