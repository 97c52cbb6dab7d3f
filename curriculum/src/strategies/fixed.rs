//! Fixed: takes the tasks in turn, at their default params. A baseline.

use serde::{Deserialize, Serialize};

use crate::core::evidence::level_move::LevelMove;
use crate::core::explanation::{Explanation, TaskExplanation, TaskStatus};
use crate::core::outcome::GroupOutcome;
use crate::core::proposal::{Proposal, ProposalRole};
use crate::core::sampler_state::SamplerOutlook;
use crate::core::settings::{Settings, TaskPlan};
use crate::core::strategy::{Strategy, StrategyContext, StrategyState};

/// State of the fixed strategy: the number of proposals so far.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(super) struct Fixed {
    proposed: u64,
}

impl Strategy for Fixed {
    fn propose(&mut self, ctx: &StrategyContext<'_>) -> Proposal {
        let tasks = &ctx.settings.tasks;
        let turn = usize::try_from(self.proposed % tasks.len() as u64).unwrap_or(0);
        self.proposed = self.proposed.saturating_add(1);
        let why = format!("its turn, {} of {}", turn + 1, tasks.len());
        Proposal { why, ..Proposal::fresh(&tasks[turn], None, ProposalRole::Sample) }
    }

    fn observe(&mut self, _outcome: &GroupOutcome, _ctx: &StrategyContext<'_>) -> Vec<LevelMove> {
        Vec::new()
    }

    fn change_settings(&mut self, _restarted: &[&str], _ctx: &StrategyContext<'_>) {}

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        settings.tasks.iter().map(|plan| TaskStatus::without_levels(&plan.task, plan.params(None))).collect()
    }

    fn sampler(&self, _plan: &TaskPlan, _ctx: &StrategyContext<'_>) -> SamplerOutlook {
        SamplerOutlook::of_params()
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        let share = 1.0 / settings.tasks.len() as f64;
        let tasks = settings.tasks.iter().map(|plan| TaskExplanation {
            task: plan.task.clone(),
            share,
            current_state: "at its default params".to_owned(),
            last_move: None,
        });
        Explanation {
            strategy: settings.strategy.to_string(),
            version: Self::VERSION,
            summary: "The tasks take turns at their default params, whatever the agent's success.".to_owned(),
            rules: vec!["Weights and levels have no effect; scenarios need not be contested.".to_owned()],
            tasks: tasks.collect(),
        }
    }
}

impl StrategyState for Fixed {
    const VERSION: u32 = 1;

    fn new(_settings: &Settings) -> Self {
        Self::default()
    }
}
