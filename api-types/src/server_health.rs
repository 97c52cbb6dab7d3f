//! Health of a server: its writer, its disk, and what waits for its workers.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Commits of the writer in the last minute, and what waits for it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WriterHealth {
    /// Changes that wait and are served first.
    pub urgent_waiting: usize,
    /// Changes that wait and are served when no urgent one waits.
    pub bulk_waiting: usize,
    /// Number of changes that fit in each queue; beyond it the server answers 429.
    pub queue_capacity: usize,
    /// Number of commits a second.
    pub commits_per_s: f64,
    /// Number of changes a second.
    pub changes_per_s: f64,
    /// Number of commits that failed.
    pub failed_commits: usize,
    /// Median duration of a commit with its sync to disk, milliseconds; null without commits.
    pub commit_p50_ms: Option<f64>,
    /// 99 % quantile of the durations, milliseconds; null without commits.
    pub commit_p99_ms: Option<f64>,
}

/// Disk of a server.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DiskHealth {
    /// Size of the database, bytes.
    pub database_bytes: i64,
    /// Part of it that deleted rows left free, bytes.
    pub reusable_bytes: i64,
    /// Free space on its disk, bytes; null where the system does not say.
    pub free_bytes: Option<u64>,
}

/// Health of a server.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ServerHealth {
    /// Version of the server.
    pub version: String,
    /// Shard of the server; null without one.
    pub shard: Option<String>,
    /// Time since its start, seconds.
    pub uptime_s: f64,
    /// Sentence that says why the database cannot be used; null while it can.
    pub outage: Option<String>,
    /// Health of its writer.
    pub writer: WriterHealth,
    /// State of its disk.
    pub disk: DiskHealth,
    /// Episodes that wait for their critique, in all runs.
    pub critiques_waiting: i64,
    /// Number of active sessions.
    pub sessions: usize,
    /// Maximum number of active sessions.
    pub sessions_limit: usize,
    /// Number of alerts that last.
    pub alerts: i64,
}
