//! Verdict on each burn, by the same episode without it and with all other burns of the log.

use std::cmp::Ordering;

use super::counterfactuals::{CounterfactualOutcome, Counterfactuals};
use super::trace::EpisodeTrace;
use crate::critique::{ActionVerdict, Verdict};
use crate::kessler::constants::{EPSILON, GOAL_THRESHOLD, HORIZON, SATELLITES};

/// Smallest difference of scores that counts: the world's ε.
const SCORE_TOLERANCE: f64 = EPSILON;

/// Judges every burn that was applied, ordered by step. All that one satellite burns in one step is one burn.
pub(super) fn judge_burns(counterfactuals: &Counterfactuals<'_>, trace: &EpisodeTrace) -> Vec<ActionVerdict> {
    let with = counterfactuals.logged_outcome();
    let mut trajectory = counterfactuals.trajectories[0].clone();
    let mut verdicts = Vec::new();
    for satellite in 0..SATELLITES {
        for step in 1..=with.outcome.steps {
            let cost = counterfactuals.trajectories[satellite].cost[step as usize];
            // The trajectory goes on after a fragment hit the satellite; and a burn of size zero is none.
            if !trace.satellite(satellite, step - 1).is_active() || cost <= 0.0 {
                continue;
            }
            counterfactuals.without_burn(satellite, step, &mut trajectory);
            let without = counterfactuals.outcome_with(satellite, &trajectory);
            verdicts.push(ActionVerdict {
                step,
                agent: satellite as u32,
                cost,
                verdict: verdict(&with, &without),
                gain: with.outcome.score - without.outcome.score,
            });
        }
    }
    verdicts.sort_by_key(|v| (v.step, v.agent));
    verdicts
}

/// Compares losses first, then the goal, then survived steps, then score.
fn verdict(with: &CounterfactualOutcome, without: &CounterfactualOutcome) -> Verdict {
    let gain = with.outcome.score - without.outcome.score;
    let meets_goal =
        |plan: &CounterfactualOutcome| plan.outcome.goal.is_some_and(|goal| goal >= GOAL_THRESHOLD);
    match with.outcome.lost.cmp(&without.outcome.lost) {
        Ordering::Less => return Verdict::Needed,
        Ordering::Greater => return Verdict::Harmful,
        Ordering::Equal => {}
    }
    if meets_goal(with) && !meets_goal(without) {
        Verdict::Needed
    } else if meets_goal(without) && !meets_goal(with) {
        Verdict::Harmful
    } else if gain > SCORE_TOLERANCE {
        Verdict::Needed
    } else if gain < -SCORE_TOLERANCE {
        // Share of the survival score that the burn cost.
        let lost_share =
            (without.survived_steps - with.survived_steps) / (f64::from(HORIZON) * SATELLITES as f64);
        if lost_share > SCORE_TOLERANCE { Verdict::Harmful } else { Verdict::Wasteful }
    } else {
        Verdict::Harmless
    }
}
