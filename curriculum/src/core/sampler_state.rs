//! Sampler of a task as users see it: where it draws scenarios, and what success it sees there.

use serde::{Deserialize, Serialize};

use super::decayed_success::DecayedSuccess;
use super::rung_tracker::TaskRungs;
use super::rungs::{RungKind, RungScale};
use super::settings::{StrategyKind, TaskPlan};

/// State of the sampler of a task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SamplerState {
    /// Id of the task.
    pub task: String,
    /// Name of the sampler: the strategy, or the sampler that `auto` chose for the task.
    pub name: String,
    /// Reason of the choice, as the end of a sentence; `None` unless `auto` chose the sampler.
    pub reason: Option<String>,
    /// State of the sampler in one sentence.
    pub state: String,
    /// Kind of the rungs; `None` if the strategy draws params instead of rungs.
    pub kind: Option<RungKind>,
    /// Rungs of the task, easiest first; empty if the strategy draws params.
    pub rungs: Vec<RungState>,
    /// Positions on the rungs: lower quartile, median and upper quartile. `None` before the first success, and under a sampler
    /// without positions.
    pub quartiles: Option<[f64; 3]>,
    /// Number of the task's latest proposals that [`RungState::draws`] counts, at most 256.
    pub proposals: u32,
}

/// One rung of a task.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RungState {
    /// Number of the rung, 0 for the easiest. It is the level if levels are the rungs.
    pub rung: u32,
    /// Value of the param `start_scale`; `None` if levels are the rungs.
    pub start_scale: Option<f64>,
    /// Probability that the task's next proposal is at this rung; `None` if the strategy does not know it.
    pub probability: Option<f64>,
    /// Number of chains at this rung; `None` if the sampler has no chains.
    pub chains: Option<u32>,
    /// Number of successes at this rung; older ones have a smaller weight.
    pub successes: f64,
    /// Number of episodes at this rung; older ones have a smaller weight, so that about 64 count at most.
    pub attempts: f64,
    /// Number of the task's latest proposals at this rung.
    pub draws: u32,
}

/// Next draws of a task, as far as its strategy knows them.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct SamplerOutlook {
    /// Sampler that was chosen for the task; `None` if the strategy has one for all tasks.
    pub(crate) choice: Option<SamplerChoice>,
    /// State of the sampler in one sentence; `None` for the one that the explanation has.
    pub(crate) state: Option<String>,
    /// Kind of the rungs; `None` if the strategy draws params.
    pub(crate) kind: Option<RungKind>,
    /// Probability of each rung; `None` if it is unknown.
    pub(crate) probabilities: Option<Vec<f64>>,
    /// Number of chains at each rung; `None` without chains.
    pub(crate) chains: Option<Vec<u32>>,
    /// Positions on the rungs: lower quartile, median and upper quartile.
    pub(crate) quartiles: Option<[f64; 3]>,
}

/// Sampler that `auto` chose for a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SamplerChoice {
    /// Name of the sampler.
    pub(crate) name: &'static str,
    /// Reason of the choice, as the end of a sentence.
    pub(crate) reason: &'static str,
}

impl SamplerOutlook {
    /// Draws of levels, whose probabilities are unknown.
    pub(crate) fn of_levels() -> Self {
        Self { kind: Some(RungKind::Level), ..Self::default() }
    }

    /// Draws of levels with these probabilities, easiest first.
    pub(crate) fn with_level_probabilities(probabilities: Vec<f64>) -> Self {
        Self { probabilities: Some(probabilities), ..Self::of_levels() }
    }

    /// Draws of params, which are at no rung.
    pub(crate) fn of_params() -> Self {
        Self::default()
    }
}

impl SamplerState {
    /// Joins the outlook of a strategy with the latest draws. `explained` describes the state of the task where the outlook
    /// does not.
    pub(crate) fn new(
        plan: &TaskPlan,
        strategy: StrategyKind,
        outlook: SamplerOutlook,
        explained: &str,
        tracked: Option<&TaskRungs>,
    ) -> Self {
        let SamplerOutlook { choice, state, kind, probabilities, chains, quartiles } = outlook;
        let scale = RungScale::new(plan);
        let rung_state = |kind: RungKind, rung: u32| {
            let success = tracked.map_or_else(DecayedSuccess::default, |of| of.success(kind, rung));
            let at = rung as usize;
            RungState {
                rung,
                start_scale: scale.start_scale(kind, rung),
                probability: probabilities.as_ref().and_then(|of| of.get(at)).copied(),
                chains: chains.as_ref().and_then(|of| of.get(at)).copied(),
                successes: success.successes,
                attempts: success.attempts(),
                draws: tracked.map_or(0, |of| of.draws(kind, rung)),
            }
        };
        let rungs = kind.map_or_else(Vec::new, |kind| {
            (0..scale.count(kind)).map(|rung| rung_state(kind, rung)).collect()
        });
        Self {
            task: plan.task.clone(),
            name: choice.map_or(strategy.name(), |choice| choice.name).to_owned(),
            reason: choice.map(|choice| choice.reason.to_owned()),
            state: state.unwrap_or_else(|| explained.to_owned()),
            kind,
            rungs,
            quartiles,
            proposals: tracked.map_or(0, TaskRungs::proposals),
        }
    }

    /// Mean rung of the task's latest proposals; `None` without proposals, and if the strategy draws params.
    #[must_use]
    pub fn mean_rung(&self) -> Option<f64> {
        let drawn: u32 = self.rungs.iter().map(|of| of.draws).sum();
        let sum: f64 = self.rungs.iter().map(|of| f64::from(of.rung) * f64::from(of.draws)).sum();
        (drawn > 0).then(|| sum / f64::from(drawn))
    }
}
