//! Fixed: the tasks in turn, at their default params. A baseline.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::event::{GroupOutcome, Move, Proposal, Role};
use super::explain::{Explanation, TaskExplanation, TaskStatus};
use super::settings::Settings;
use super::strategy::{Context, Strategy};

const VERSION: u32 = 1;

/// Whose turn it is.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(super) struct Fixed {
    proposed: u64,
}

impl Fixed {
    pub(super) fn restore(state: &Value) -> Result<Self, serde_json::Error> {
        Self::deserialize(state)
    }
}

impl Strategy for Fixed {
    fn propose(&mut self, ctx: &Context<'_>) -> Proposal {
        let tasks = &ctx.settings.tasks;
        let turn = usize::try_from(self.proposed % tasks.len() as u64).unwrap_or(0);
        self.proposed += 1;
        let plan = &tasks[turn];
        let why = format!("its turn, {} of {}", turn + 1, tasks.len());
        Proposal { why, ..Proposal::at(plan, None, Role::Sample) }
    }

    fn observe(&mut self, _outcome: &GroupOutcome, _ctx: &Context<'_>) -> Vec<Move> {
        Vec::new()
    }

    fn adopt(&mut self, _afresh: &[&str], _ctx: &Context<'_>) {}

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        settings.tasks.iter().map(|plan| TaskStatus::unmoved(&plan.task, plan.params(None))).collect()
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        let share = 1.0 / settings.tasks.len() as f64;
        Explanation {
            strategy: settings.strategy.to_string(),
            version: VERSION,
            summary: "The tasks in turn at their default params, whatever the agent can do.".to_owned(),
            rules: vec!["Weights and levels play no part; scenarios are as they come.".to_owned()],
            tasks: (settings.tasks.iter())
                .map(|plan| TaskExplanation {
                    task: plan.task.clone(),
                    share,
                    now: "at its default params".to_owned(),
                    last_move: None,
                })
                .collect(),
        }
    }

    fn snapshot(&self) -> Value {
        Value::from_iter([("proposed", self.proposed)])
    }

    fn version(&self) -> u32 {
        VERSION
    }

    fn boxed_clone(&self) -> Box<dyn Strategy> {
        Box::new(*self)
    }
}
