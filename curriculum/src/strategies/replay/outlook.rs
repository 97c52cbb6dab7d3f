//! Probabilities of the levels of a task's next proposal.

use super::level_buffer::RankWeights;
use super::{TaskBuffer, replay_threshold};
use crate::core::probabilities::{LevelWeight, level_shares, mix, uniform_probabilities};
use crate::core::settings::TaskPlan;
use crate::core::settings::hyperparameters::replay::{REPLAY, STALENESS};
use crate::core::strategy::StrategyContext;

/// Probability of each level: an edit that waits comes first, then a share of repeated scenarios, and the rest is fresh.
pub(super) fn level_probabilities(
    task: &TaskBuffer,
    plan: &TaskPlan,
    ctx: &StrategyContext<'_>,
    rank_weights: &RankWeights,
) -> Vec<f64> {
    let count = plan.hardest_level() + 1;
    if let Some(level) = task.edits.iter().find_map(|of| task.buffer.get(*of)).and_then(|parent| parent.level)
    {
        return level_shares(count, [LevelWeight { level, weight: 1.0 }]);
    }
    let explored = uniform_probabilities(count);
    if task.buffer.len() == 0 || task.buffer.len() < replay_threshold(ctx.settings) {
        return explored;
    }
    let hyperparameters = &ctx.settings.hyperparameters;
    let by_staleness = level_shares(count, task.buffer.levels_by_staleness(ctx.seq));
    let by_rank = level_shares(count, task.buffer.levels_by_rank(rank_weights));
    let repeated = mix(hyperparameters.number(&STALENESS), &by_staleness, &by_rank);
    mix(hyperparameters.number(&REPLAY), &repeated, &explored)
}
