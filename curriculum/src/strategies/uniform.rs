//! Uniform: draws every level of a task with equal probability. Domain randomisation (Tobin et al. 2017), a baseline.

use serde::{Deserialize, Serialize};

use crate::core::evidence::level_move::LevelMove;
use crate::core::explanation::Explanation;
use crate::core::outcome::GroupOutcome;
use crate::core::probabilities::uniform_probabilities;
use crate::core::proposal::{Proposal, ProposalRole};
use crate::core::sampler_state::SamplerOutlook;
use crate::core::settings::{Settings, TaskPlan};
use crate::core::shares;
use crate::core::strategy::{Strategy, StrategyContext, StrategyState};

/// The uniform strategy, which has no state.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Uniform;

impl Strategy for Uniform {
    fn propose(&mut self, ctx: &StrategyContext<'_>) -> Proposal {
        let mut rng = ctx.rng();
        let plan = shares::pick_task(ctx.settings, rng.uniform());
        let level = rng.below(plan.hardest_level() + 1);
        let why = format!("level {level}, drawn uniformly from 0 to {}", plan.hardest_level());
        Proposal { why, ..Proposal::fresh(plan, Some(level), ProposalRole::Sample) }
    }

    fn observe(&mut self, _outcome: &GroupOutcome, _ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        Vec::new()
    }

    fn change_settings(&mut self, _restarted: &[&str], _ctx: &StrategyContext<'_>) {}

    fn sampler(&self, plan: &TaskPlan, _ctx: &StrategyContext<'_>) -> SamplerOutlook {
        SamplerOutlook::with_level_probabilities(uniform_probabilities(plan.hardest_level() + 1))
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        let rules = vec![
            "Tasks share the proposals by weight, each at least 5 %.".to_owned(),
            "Levels are drawn uniformly from the task's table; scenarios need not be contested.".to_owned(),
        ];
        let summary = "Every level is equally likely, whatever the agent's success.";
        Explanation::without_levels(settings, Self::VERSION, summary, rules, |plan| {
            format!("any of levels 0 to {}", plan.hardest_level())
        })
    }
}

impl StrategyState for Uniform {
    const VERSION: u32 = 1;

    fn new(_settings: &Settings) -> Self {
        Self
    }
}
