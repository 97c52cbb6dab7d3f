//! The curriculum for people: where each task stands and by which rules it moves.

use serde::{Deserialize, Serialize};

use super::settings::{Settings, TaskPlan};
use super::shares;

/// Where a task stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TaskStatus {
    /// The task's id.
    pub task: String,
    /// The current level, 0 during placement; none under a strategy without levels to climb.
    pub level: Option<u32>,
    /// Whether the level was found: false during placement.
    pub placed: bool,
    /// The level probed now, during placement.
    pub probing: Option<u32>,
    /// How many moves, steps of placement included, the task has had.
    pub epoch: u32,
    /// The params in force: of the current level, of the level probed, or the task's defaults. Empty where they change
    /// with every proposal (uniform).
    pub params: Vec<(String, f64)>,
    /// How far the block (or the probe) now filling is.
    pub block: Option<BlockFill>,
    /// Blocks that counted at this level since the last move; probes that decided, during placement.
    pub blocks: u32,
    /// Blocks (or probes) that did not count since the last move, because too many episodes were lost.
    pub discarded: u32,
    /// What somebody should know, in sentences.
    pub warnings: Vec<String>,
    /// What it takes to move; none under a strategy without levels to climb.
    pub next: Option<Thresholds>,
    /// The seq of the earliest proposal that the evidence now gathering rests on, for who must keep that.
    #[serde(skip)]
    pub rests_on: Option<u64>,
}

impl TaskStatus {
    /// A task that no evidence moves.
    pub(super) fn unmoved(task: &str, params: Vec<(String, f64)>) -> Self {
        Self {
            task: task.to_owned(),
            level: None,
            placed: true,
            probing: None,
            epoch: 0,
            params,
            block: None,
            blocks: 0,
            discarded: 0,
            warnings: Vec::new(),
            next: None,
            rests_on: None,
        }
    }
}

/// How far a block is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BlockFill {
    /// Contested scenarios in it.
    pub n: u32,
    /// Contested scenarios that fill it.
    pub of: u32,
    /// Sum of their success shares.
    pub sum: f64,
    /// Mean of their success shares; none of none.
    pub mean: Option<f64>,
    /// Its episodes that failed or expired.
    pub lost: u32,
}

/// What it takes to move, in words.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Thresholds {
    /// To go up, or to pass the level probed; none at the top.
    pub up: Option<String>,
    /// To go down, or to fail the level probed; none at the bottom.
    pub down: Option<String>,
}

/// How a curriculum decides and what it decided last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Explanation {
    /// The strategy's name.
    pub strategy: String,
    /// The version of its rules.
    pub version: u32,
    /// What it does, in one sentence.
    pub summary: String,
    /// Its rules, with their numbers.
    pub rules: Vec<String>,
    /// Its tasks.
    pub tasks: Vec<TaskExplanation>,
}

impl Explanation {
    /// Of a strategy that goes by weights and moves no levels: its rules, its settings, and where each task stands.
    pub(super) fn of(
        settings: &Settings,
        version: u32,
        (summary, mut rules): (&str, Vec<String>),
        now: impl Fn(&TaskPlan) -> String,
    ) -> Self {
        rules.extend(settings.tuning.in_words());
        let tasks = settings.tasks.iter().zip(shares::shares(settings)).map(|(plan, share)| {
            TaskExplanation { task: plan.task.clone(), share, now: now(plan), last_move: None }
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
    /// The task's id.
    pub task: String,
    /// Its share of the proposals.
    pub share: f64,
    /// Where it stands.
    pub now: String,
    /// What moved it last, and on what evidence.
    pub last_move: Option<String>,
}
