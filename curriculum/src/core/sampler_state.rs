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
    /// Position of the sampler in one sentence.
    pub position: String,
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
    /// Position in one sentence; `None` for the state that the explanation has.
    pub(crate) position: Option<String>,
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
    /// Joins the outlook of a strategy with the latest draws. `position` describes the state of the task where the outlook
    /// does not.
    pub(crate) fn new(
        plan: &TaskPlan,
        strategy: StrategyKind,
        outlook: SamplerOutlook,
        position: &str,
        tracked: Option<&TaskRungs>,
    ) -> Self {
        let SamplerOutlook { choice, position: own, kind, probabilities, chains, quartiles } = outlook;
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
            position: own.unwrap_or_else(|| position.to_owned()),
            kind,
            rungs,
            quartiles,
            proposals: tracked.map_or(0, TaskRungs::proposals),
        }
    }
}

/// Equal probabilities of `count` rungs.
pub(crate) fn uniform_probabilities(count: u32) -> Vec<f64> {
    vec![1.0 / f64::from(count.max(1)); count as usize]
}

/// Weights divided by their sum; equal probabilities if the sum is 0.
pub(crate) fn normalize(weights: &[f64]) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    if sum > 0.0 {
        weights.iter().map(|weight| weight / sum).collect()
    } else {
        uniform_probabilities(u32::try_from(weights.len()).unwrap_or(u32::MAX))
    }
}

/// Mixture: a share of the draws from `first`, 0 to 1, and the others from `rest`.
pub(crate) fn mix(share: f64, first: &[f64], rest: &[f64]) -> Vec<f64> {
    first.iter().zip(rest).map(|(first, rest)| share * first + (1.0 - share) * rest).collect()
}

/// Level of a scenario, and the weight with which the scenario is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LevelWeight {
    pub(crate) level: u32,
    pub(crate) weight: f64,
}

/// Share of each of `count` levels in the weights of scenarios at these levels. If all weights are 0, the first scenario is drawn.
pub(crate) fn level_shares(count: u32, scenarios: impl IntoIterator<Item = LevelWeight>) -> Vec<f64> {
    let mut weights = vec![0.0; count as usize];
    let mut first = None;
    for LevelWeight { level, weight } in scenarios {
        first.get_or_insert(level);
        if let Some(sum) = weights.get_mut(level as usize) {
            *sum += weight;
        }
    }
    if weights.iter().all(|weight| *weight == 0.0)
        && let Some(only) = first.and_then(|level| weights.get_mut(level as usize))
    {
        *only = 1.0;
    }
    normalize(&weights)
}
