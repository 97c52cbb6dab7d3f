//! Probabilities of the levels of a task's next proposal.

use super::{ScenarioPool, ranking_method};
use crate::core::probabilities::{LevelWeight, level_shares, mix, normalize, uniform_probabilities};
use crate::core::settings::hyperparameters::learnability::{RankingMethod, SHARE};
use crate::core::settings::{Settings, TaskPlan};

/// Probability of each level: a share of the proposals follows the ranking, the rest explores.
pub(super) fn level_probabilities(pool: &ScenarioPool, settings: &Settings, plan: &TaskPlan) -> Vec<f64> {
    let count = plan.hardest_level() + 1;
    let share = settings.hyperparameters.number(&SHARE);
    let explored = uniform_probabilities(count);
    if ranking_method(settings) == RankingMethod::Model {
        return mix(share, &normalize(&pool.model.level_weights(plan)), &explored);
    }
    // The oldest scenario that needs another group is repeated before a fresh one is drawn.
    let repeated = pool.repeat_queue.front().and_then(|seq| pool.trials.get(seq)?.level);
    let rest = repeated.map_or(explored, |level| level_shares(count, [LevelWeight { level, weight: 1.0 }]));
    if pool.kept.is_empty() {
        return rest;
    }
    let kept =
        pool.kept.iter().filter_map(|scenario| Some(LevelWeight { level: scenario.level?, weight: 1.0 }));
    mix(share, &level_shares(count, kept), &rest)
}
