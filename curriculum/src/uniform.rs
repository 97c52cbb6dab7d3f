//! Uniform: every level of every task at any time. Domain randomisation (Tobin et al. 2017), a baseline.

use serde_json::Value;

use super::event::{GroupOutcome, Move, Proposal, Role};
use super::explain::{Explanation, TaskStatus};
use super::settings::Settings;
use super::shares;
use super::strategy::{Context, Strategy};

const VERSION: u32 = 1;

/// Remembers nothing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Uniform;

impl Strategy for Uniform {
    fn propose(&mut self, ctx: &Context<'_>) -> Proposal {
        let mut draws = ctx.draws();
        let plan = shares::pick(ctx.settings, draws.uniform());
        let level = draws.below(plan.top() + 1);
        let why = format!("level {level}, drawn uniformly from 0 to {}", plan.top());
        Proposal { why, ..Proposal::at(plan, Some(level), Role::Sample) }
    }

    fn observe(&mut self, _outcome: &GroupOutcome, _ctx: &Context<'_>) -> Vec<Move> {
        Vec::new()
    }

    fn adopt(&mut self, _afresh: &[&str], _ctx: &Context<'_>) {}

    fn status(&self, settings: &Settings) -> Vec<TaskStatus> {
        settings.tasks.iter().map(|plan| TaskStatus::unmoved(&plan.task, Vec::new())).collect()
    }

    fn explain(&self, settings: &Settings) -> Explanation {
        let rules = vec![
            "Tasks by their weight, each at least 5 %.".to_owned(),
            "Levels uniformly over the task's table, scenarios as they come.".to_owned(),
        ];
        let summary = "Every level is as likely as any other, whatever the agent can do.";
        Explanation::of(settings, VERSION, (summary, rules), |plan| {
            format!("any of levels 0 to {}", plan.top())
        })
    }

    fn snapshot(&self) -> Value {
        Value::Null
    }

    fn version(&self) -> u32 {
        VERSION
    }

    fn boxed_clone(&self) -> Box<dyn Strategy> {
        Box::new(*self)
    }
}
