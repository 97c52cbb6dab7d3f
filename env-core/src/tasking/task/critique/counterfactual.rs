//! Verdicts on actions. The counterfactual of an action is the same episode in which the satellite went on with its previous task
//! until the action ended; later actions of the log are applied by their index.

use std::cmp::Ordering;

use super::fork::{ForkChange, ForkRequest, ForkResult};
use super::trace::{TaskingTrace, TracedAction};
use crate::bracket::EpisodeOutcome;
use crate::critique::{ActionVerdict, Verdict};

/// Cost that the counterfactuals of a critique may have, in satellite-seconds. If those of all actions cost more, only every second
/// action is compared, or every third, and so on.
pub(super) const BUDGET: f64 = 1.5e6;

/// Cost of a step in satellite-seconds, for each pair of satellites: the search for lines of sight.
const COST_OF_PAIR: f64 = 3.0;

/// Largest difference of scores that is not relevant: 28 s of a whole scanning episode.
const RELEVANT_GAIN: f64 = 1e-3;

/// An action to be judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct JudgedAction {
    /// Step of the action, from 1.
    pub step: u32,
    /// Number of the agent.
    pub agent: usize,
    /// Tick at which the action ended.
    pub until: u64,
    /// True if the action repeats the last one, so that it changes nothing.
    pub is_repeat: bool,
}

impl JudgedAction {
    /// The fork without the action; `None` if it is the episode itself.
    pub(super) fn request(&self) -> Option<ForkRequest> {
        let change = ForkChange::WithoutAction { agent: self.agent, until: self.until };
        (!self.is_repeat).then_some(ForkRequest { step: self.step, change })
    }
}

/// Actions that are judged, by step and agent: all that repeat the last one, and as many of the others as the budget allows, evenly
/// spaced.
pub(super) fn judged_actions(trace: &TaskingTrace, budget: f64) -> Vec<JudgedAction> {
    let mut actions = Vec::new();
    for (agent, satellite) in trace.satellites.iter().enumerate() {
        let judged = |action: &TracedAction| JudgedAction {
            step: action.step,
            agent,
            until: action.end,
            is_repeat: action.is_repeat,
        };
        actions.extend(satellite.actions.iter().map(|action| (action.start, judged(action))));
    }
    actions.sort_by_key(|(_, action)| (action.step, action.agent));
    let costs: Vec<f64> =
        actions.iter().filter(|(_, a)| !a.is_repeat).map(|(start, _)| cost(trace, *start)).collect();
    let total = |stride: usize| costs.iter().step_by(stride).sum::<f64>();
    let stride = (1..=costs.len()).find(|stride| total(*stride) <= budget).unwrap_or(costs.len() + 1);
    let mut others = 0;
    actions.retain(|(_, action)| {
        others += usize::from(!action.is_repeat);
        action.is_repeat || (others - 1).is_multiple_of(stride)
    });
    actions.into_iter().map(|(_, action)| action).collect()
}

/// Cost of an episode from a tick to its end, in satellite-seconds.
fn cost(trace: &TaskingTrace, start: u64) -> f64 {
    let satellites = trace.satellites.len() as f64;
    let steps = (trace.steps() + 1).saturating_sub(trace.step_at(start + 1));
    let seconds = trace.time_s(trace.end().saturating_sub(start));
    satellites * (seconds + COST_OF_PAIR * satellites * f64::from(steps))
}

/// Verdicts on actions, by the results of the forks of those that do not repeat the last one.
pub(super) fn verdicts(
    actual: &EpisodeOutcome,
    actions: &[JudgedAction],
    results: &[ForkResult],
) -> Vec<ActionVerdict> {
    let mut results = results.iter();
    let verdict = |action: &JudgedAction| {
        let without = match action.is_repeat {
            true => *actual,
            false => match results.next() {
                Some(ForkResult::Outcome(outcome)) => *outcome,
                _ => *actual,
            },
        };
        let gain = actual.score - without.score;
        ActionVerdict {
            step: action.step,
            agent: action.agent as u32,
            cost: 0.0,
            verdict: verdict_of(actual.lost.cmp(&without.lost), gain),
            gain,
        }
    };
    actions.iter().map(verdict).collect()
}

/// Compares losses first, then scores.
fn verdict_of(losses: Ordering, gain: f64) -> Verdict {
    match losses {
        Ordering::Less => Verdict::Needed,
        Ordering::Greater => Verdict::Harmful,
        Ordering::Equal if gain > RELEVANT_GAIN => Verdict::Needed,
        Ordering::Equal if gain < -RELEVANT_GAIN => Verdict::Wasteful,
        Ordering::Equal => Verdict::Harmless,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_count_before_scores() {
        assert_eq!(verdict_of(Ordering::Less, -0.5), Verdict::Needed);
        assert_eq!(verdict_of(Ordering::Greater, 0.5), Verdict::Harmful);
        let equal = |gain| verdict_of(Ordering::Equal, gain);
        assert_eq!(
            [0.002, 0.0, -0.0005, -0.002].map(equal),
            [Verdict::Needed, Verdict::Harmless, Verdict::Harmless, Verdict::Wasteful]
        );
    }
}
