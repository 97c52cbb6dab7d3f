//! Status and explanation of a curriculum: the state of each task, and the rules by which it changes.

use serde::{Deserialize, Serialize};

use super::settings::{Settings, TaskPlan};
use super::shares;

/// Current state of a task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TaskStatus {
    /// Id of the task.
    pub task: String,
    /// Current level, 0 during placement; `None` under a strategy without a current level.
    pub level: Option<u32>,
    /// True if the first level is set; false during placement.
    pub placement_done: bool,
    /// Level being probed, during placement.
    pub probe_level: Option<u32>,
    /// Number of moves of the task so far, steps of placement included.
    pub epoch: u32,
    /// Params in force: of the current level, of the probed level, at the bounds, or the task's defaults. Empty if
    /// they change with every proposal (uniform).
    pub params: Vec<(String, f64)>,
    /// Progress of the block or probe that is filling.
    pub block: Option<BlockProgress>,
    /// Number of full blocks at this level since the last move; during placement, of probes that ended.
    pub blocks: u32,
    /// Reason why the level does not rise although results are there, in one sentence: results are missing, or wait
    /// for results of earlier leases. `None` if missing results hold nothing back.
    pub held_back: Option<String>,
    /// Problems that the user should know about, one sentence each.
    pub warnings: Vec<String>,
    /// Conditions for the next move; `None` under a strategy without a current level.
    pub move_conditions: Option<MoveThresholds>,
    /// Seq of the earliest proposal behind the evidence that is gathering; its records must be kept.
    #[serde(skip)]
    pub earliest_proposal: Option<u64>,
}

impl TaskStatus {
    /// Status of a task whose level no evidence moves.
    pub(crate) fn without_levels(task: &str, params: Vec<(String, f64)>) -> Self {
        Self {
            task: task.to_owned(),
            level: None,
            placement_done: true,
            probe_level: None,
            epoch: 0,
            params,
            block: None,
            blocks: 0,
            held_back: None,
            warnings: Vec::new(),
            move_conditions: None,
            earliest_proposal: None,
        }
    }
}

/// Progress of a block of slots.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BlockProgress {
    /// Number of settled slots in the block.
    pub n: u32,
    /// Number of slots in a full block.
    pub size: u32,
    /// Sum of their success rates, missing episodes counted as failures.
    pub low: f64,
    /// Sum of their success rates, missing episodes counted as successes.
    pub high: f64,
    /// Mean success rate, low / n; `None` while the block is empty.
    pub mean: Option<f64>,
    /// Share of the outcomes that are missing; `None` while the block is empty.
    pub missing: Option<f64>,
    /// Number of leased slots without a result.
    pub open: u32,
    /// Number of slots with a result that wait for earlier slots.
    pub waiting: u32,
}

/// Conditions for the next move, one sentence each.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct MoveThresholds {
    /// Condition to move up, or to pass the probed level; `None` at the hardest level.
    pub up: Option<String>,
    /// Condition to move down, or to fail the probed level; `None` at the easiest level.
    pub down: Option<String>,
}

/// Rules of a curriculum and its latest decisions, as text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// Name of the strategy.
    pub strategy: String,
    /// Version of its rules.
    pub version: u32,
    /// Summary of the strategy in one sentence.
    pub summary: String,
    /// Rules with their numbers.
    pub rules: Vec<String>,
    /// Tasks of the run.
    pub tasks: Vec<TaskExplanation>,
}

impl Explanation {
    /// Explains a strategy that shares proposals by weight and moves no levels: its rules, its hyperparameters and
    /// the state of each task as `describe_task` words it.
    pub(crate) fn without_levels(
        settings: &Settings,
        version: u32,
        summary: &str,
        mut rules: Vec<String>,
        describe_task: impl Fn(&TaskPlan) -> String,
    ) -> Self {
        rules.extend(settings.hyperparameters.describe());
        let tasks =
            settings.tasks.iter().zip(shares::task_shares(settings)).map(|(plan, share)| TaskExplanation {
                task: plan.task.clone(),
                share,
                current_state: describe_task(plan),
                last_move: None,
            });
        Self {
            strategy: settings.strategy.to_string(),
            version,
            summary: summary.to_owned(),
            rules,
            tasks: tasks.collect(),
        }
    }
}

/// One task of an explanation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TaskExplanation {
    /// Id of the task.
    pub task: String,
    /// Share of the proposals, 0 to 1.
    pub share: f64,
    /// Current state in one sentence.
    pub current_state: String,
    /// Evidence of the last move in one sentence.
    pub last_move: Option<String>,
}
