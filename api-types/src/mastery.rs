//! Mastery of a run's tasks, level moves, and the params in force.

use std::collections::BTreeMap;

use curriculum::{Explanation, TaskStatus};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

/// Mastery of all tasks of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunMastery {
    /// One entry for each task of the run.
    pub tasks: Vec<TaskMastery>,
    /// Rules of the strategy and its latest decisions, as text.
    #[schema(value_type = Object)]
    pub explanation: Explanation,
}

/// Mastery of one task.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TaskMastery {
    /// Id of the task.
    pub task: String,
    /// Current level; null during placement and under a strategy without levels.
    pub level: Option<u32>,
    /// Level that placement probes now.
    pub probe_level: Option<u32>,
    /// True if the first level is set.
    pub placement_done: bool,
    /// Mean rung of the task's latest proposals, at most 256, from 0 for the easiest; null before the first proposal, and under a
    /// strategy that draws params.
    pub mean_rung: Option<f64>,
    /// Current params: those of the current level, or of the probed level.
    pub params: BTreeMap<String, f64>,
    /// Posterior of success on contested scenarios at the current level; null under a strategy without levels.
    pub mastery: Option<MasteryEstimate>,
    /// Posterior of success for each level with evidence.
    pub levels: Vec<MasteryEstimate>,
    /// Results of all episodes, contested or not, except those on designed layouts.
    pub results: EpisodeCounts,
    /// Results of the episodes on designed layouts, which aim at the agent's failures.
    pub designed_results: EpisodeCounts,
    /// Episodes of claims of columns. They do not move mastery, except for audited groups, which `results` counts.
    pub claimed_results: ClaimedEpisodeCounts,
    /// Numbers of closed groups with several episodes; all zeros if groups have one episode.
    pub group_counts: GroupCounts,
    /// Reason why the level does not rise although results are there, in one sentence; null if missing results hold nothing back.
    pub held_back: Option<String>,
    /// Progress of the current block, and the conditions of the next level move.
    #[schema(value_type = Object)]
    pub status: TaskStatus,
    /// Warnings about the evidence of the task, one sentence each.
    pub warnings: Vec<String>,
}

/// Posterior of success: Beta(1, 1) updated by the last 64 slots. Mean and 10 % quantile count missing episodes as failures, the 90 %
/// quantile as successes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MasteryEstimate {
    /// Level of the estimate.
    pub level: Option<u32>,
    /// Number of slots behind the estimate.
    pub n: u32,
    /// Mean of the posterior, missing episodes counted as failures.
    pub mean: f64,
    /// 10 % quantile of the posterior, missing episodes counted as failures.
    pub q10: f64,
    /// 90 % quantile of the posterior, missing episodes counted as successes.
    pub q90: f64,
    /// Share of the outcomes behind the estimate that are missing, from 0 to 1.
    pub missing: f64,
    /// Number of slots that do not count yet: leased without a result, or with one that waits for earlier slots.
    pub open: u32,
    /// Number of slots since the start of the run.
    pub seen: u64,
}

impl MasteryEstimate {
    /// Estimate of a level without evidence: Beta(1, 1), the uniform distribution.
    #[must_use]
    pub const fn without_evidence(level: u32) -> Self {
        Self { level: Some(level), n: 0, mean: 0.5, q10: 0.1, q90: 0.9, missing: 0.0, open: 0, seen: 0 }
    }
}

/// Numbers of closed groups with several episodes, over all levels.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
pub struct GroupCounts {
    /// Number of groups of which all episodes finished.
    pub complete: i64,
    /// Number of groups of which at least `min_group` episodes finished.
    pub partial: i64,
    /// Number of groups of which fewer episodes finished.
    pub lost: i64,
    /// Number of complete and partial groups whose episodes all have the same score, so that they carry no learning signal.
    pub zero_variance: i64,
    /// zero_variance / (complete + partial).
    pub zero_variance_share: Option<f64>,
}

/// Numbers of episodes and their mean results.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EpisodeCounts {
    /// Number of finished episodes.
    pub episodes: i64,
    /// Number of successes among them.
    pub successes: i64,
    /// Number of failed episodes.
    pub failed: i64,
    /// Number of expired episodes.
    pub expired: i64,
    /// Success rate with missing episodes counted as failures: successes / (episodes + failed + expired).
    pub success: Option<f64>,
    /// Success rate with missing episodes counted as successes.
    pub success_high: Option<f64>,
    /// Share of missing episodes, (failed + expired) / (episodes + failed + expired).
    pub missing: Option<f64>,
    /// Mean score of the episodes.
    pub score: Option<f64>,
    /// Mean skill, over scenarios that define one.
    pub skill: Option<f64>,
}

/// Episodes of claims of columns.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
pub struct ClaimedEpisodeCounts {
    /// Number of finished episodes of accepted claims.
    pub episodes: i64,
    /// Mean claimed score of the finished episodes of accepted claims.
    pub score: Option<f64>,
    /// Number of failed episodes of accepted claims.
    pub failed: i64,
    /// Number of episodes of refused claims.
    pub refused: i64,
    /// Number of episodes of claims whose audited logs were never reported.
    pub unproven: i64,
    /// Number of leased episodes that were never claimed.
    pub expired: i64,
}

/// Page of level moves.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct LevelMovePage {
    /// Level moves, oldest first.
    pub moves: Vec<RecordedMove>,
    /// Success on contested scenarios over time: the evidence of each task in at most 100 parts of about equal size, each at least a
    /// minute long. Empty except on the first page.
    pub points: Vec<EvidencePoint>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Part of a task's evidence.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EvidencePoint {
    /// Id of the task.
    pub task: String,
    /// End of the part, RFC 3339.
    pub at: String,
    /// Lowest and highest level in the part.
    pub levels: Option<[i64; 2]>,
    /// Number of contested scenarios.
    pub n: i64,
    /// Mean of their success rates.
    pub success: f64,
}

/// Change of a task's level, as it is stored.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RecordedMove {
    /// Sequence number of the event that caused the move.
    pub seq: i64,
    /// Id of the task.
    pub task: String,
    /// Direction of the move.
    pub kind: LevelMoveKind,
    /// Level before the move; null if placement had not ended.
    pub from: Option<i64>,
    /// Level after the move.
    pub to: i64,
    /// Blocks or probes that the move is based on.
    #[schema(value_type = Object)]
    pub evidence: Value,
    /// Time of the move, RFC 3339.
    pub at: String,
}

/// Current params of a run, by task.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunParams {
    /// Params by name, for each task id.
    pub tasks: BTreeMap<String, BTreeMap<String, f64>>,
}

/// Direction of a level move.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LevelMoveKind {
    /// Placement ended, and the run starts at this level.
    Placement,
    /// The task moved one level up.
    Up,
    /// The task moved one level down.
    Down,
}
