//! Overview of a run.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::EventKind;

/// Overview of a run: throughput, leases and levels.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunOverview {
    /// Id of the run.
    pub run: String,
    /// Number of finished episodes, columns included.
    pub episodes: i64,
    /// Throughput over the last five minutes, episodes per second.
    pub episodes_per_s: f64,
    /// Time of the first results, RFC 3339; null before there are any.
    pub first_results_at: Option<String>,
    /// Time of the latest results, RFC 3339; null before there are any.
    pub last_results_at: Option<String>,
    /// Number of active leases.
    pub leases: i64,
    /// Number of prepared scenarios that can be leased.
    pub prepared: i64,
    /// Number of proposals whose scenarios are being prepared.
    pub proposed: i64,
    /// Level and mastery of each task.
    pub tasks: Vec<TaskOverview>,
    /// Mean skill of all tasks from the first results to the latest, in at most 60 parts of equal duration; null for a part without
    /// results.
    pub skill: Vec<Option<f64>>,
    /// Latest event of the run.
    pub latest_event: Option<LatestEvent>,
}

/// Level and mastery of a task.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TaskOverview {
    /// Id of the task.
    pub task: String,
    /// Current level; null during placement and under a strategy without levels.
    pub level: Option<i64>,
    /// Mean of the posterior of success on contested scenarios, missing episodes counted as failures; null before there is evidence.
    pub mastery: Option<f64>,
    /// 10 % quantile of the posterior, missing episodes counted as failures.
    pub mastery_low: Option<f64>,
    /// 90 % quantile of the posterior, missing episodes counted as successes.
    pub mastery_high: Option<f64>,
    /// Share of the outcomes behind the posterior that are missing.
    pub missing: Option<f64>,
    /// Reason why the level does not rise although results are there, in one sentence; null if missing results hold nothing back.
    pub held_back: Option<String>,
}

/// Latest event of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct LatestEvent {
    /// Kind of the event.
    pub kind: EventKind,
    /// Time of the event, RFC 3339.
    pub at: String,
}
