//! Runs and the history of their settings.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

use crate::{CritiqueBacklog, RunActivity};

/// Run, as lists show it.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunSummary {
    /// Id of the run.
    pub id: String,
    /// Name of the run for people.
    pub name: String,
    /// Seed of the run's random streams.
    pub seed: u64,
    /// True if another run, possibly a deleted one, has the same seed. Trainers may then know scenarios and plans before they lease them, so
    /// that groups of leases with `disclosure: begin` count from the lease on.
    pub seed_reused: bool,
    /// Status of the run.
    pub status: RunStatus,
    /// Time of creation, RFC 3339.
    pub created_at: String,
    /// Time of archiving, RFC 3339.
    pub archived_at: Option<String>,
    /// Newest policy version that the trainer reported.
    pub policy_version: i64,
    /// Tags of the run, in alphabetical order.
    pub tags: Vec<String>,
    /// Principal that owns the run; null if the run was created without authentication.
    pub owner: Option<String>,
    /// Principals that may take part in the run beside its owner, in alphabetical order. In a run without an owner, every trainer may.
    pub members: Vec<String>,
    /// Note of the team; empty if there is none.
    pub note: String,
    /// Activity of the run, by its status and its latest results.
    pub activity: RunActivity,
    /// Number of finished episodes, columns included.
    pub episodes: i64,
    /// Mean skill of the latest episodes: the weight of an episode halves every 1 000 episodes. Null before there are any with a skill.
    pub skill: Option<f64>,
    /// Time of the first results, RFC 3339; null before there are any.
    pub first_results_at: Option<String>,
    /// Time of the latest results, RFC 3339; null before there are any.
    pub last_results_at: Option<String>,
    /// Complete settings of the run.
    #[schema(value_type = Object)]
    pub settings: Value,
}

/// Run with its warnings and the backlog of its critique.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Run {
    /// The run, as lists show it.
    #[serde(flatten)]
    pub summary: RunSummary,
    /// Backlog of the critique.
    pub critique_backlog: CritiqueBacklog,
    /// Warnings of the run: their number and the newest ones.
    pub warnings: RunWarnings,
}

/// Warnings of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunWarnings {
    /// Number of all warnings.
    pub count: i64,
    /// Newest warnings, newest first, at most 20.
    pub newest: Vec<RunWarning>,
}

/// Warning of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunWarning {
    /// Kind of the warning.
    pub kind: RunWarningKind,
    /// Id of the lease concerned.
    pub lease: Option<String>,
    /// Description in one sentence.
    pub message: String,
    /// Time of the warning, RFC 3339.
    pub at: String,
}

/// Tags of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RunTagsRequest {
    /// All tags of the run, at most 32. A tag has 1 to 64 of a-z, 0-9, _, ., : and -, and begins with a letter or a digit.
    pub tags: Vec<String>,
}

/// Members of a run, and its owner.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RunMembersRequest {
    /// All principals that may take part in the run beside its owner, at most 100.
    pub members: Vec<String>,
    /// Principal that becomes the owner (default: the owner stays). Only an admin can set it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub owner: Option<String>,
}

/// Note of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RunNoteRequest {
    /// Note of the team, at most 2 000 characters. An empty text removes the note.
    #[schema(max_length = 2000)]
    pub note: String,
}

/// Request to archive several runs.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ArchiveRequest {
    /// Ids of the runs, 1 to 1 000.
    #[schema(min_items = 1, max_items = 1000)]
    pub runs: Vec<String>,
}

/// Runs that were archived.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ArchivedRuns {
    /// The runs in the order of the request.
    pub runs: Vec<RunSummary>,
}

/// Confirmation of a deletion.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct RunDeletionQuery {
    /// Name of the run, which confirms the deletion.
    pub name: String,
}

/// Newest policy version of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PolicyVersionRequest {
    /// Number of the policy version.
    pub policy_version: u32,
}

/// Page of the history of a run's settings.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunSettingsPage {
    /// Settings of the page, newest first.
    pub settings: Vec<RunSettingsVersion>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Settings of a run from a moment on.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunSettingsVersion {
    /// Number of the version, from 0.
    pub revision: i64,
    /// Time from which the settings apply, RFC 3339.
    pub at: String,
    /// Complete settings, as they were stored then.
    #[schema(value_type = Object)]
    pub settings: Value,
}

/// Status of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunStatus {
    /// The run grants leases.
    Active,
    /// The run grants no leases. Results of earlier leases are still accepted.
    Paused,
}

/// Kind of a warning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunWarningKind {
    /// An audited log did not replay as the columns of its lease claim.
    RefusedClaim,
    /// Audited logs of a claim were not reported before the lease ended.
    UnprovenClaim,
}
