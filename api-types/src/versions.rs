//! Versions of a run's policy.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Version of a run's policy, with its results.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct PolicyVersion {
    /// Number of the policy version.
    pub version: i64,
    /// Number of versions between it and the newest.
    pub staleness: i64,
    /// Location of the weights, as the trainer described it.
    pub checkpoint: Option<String>,
    /// Notes of the trainer.
    pub notes: Option<String>,
    /// Time of the description, RFC 3339; null if the version is known from results only.
    pub described_at: Option<String>,
    /// Results by task, over all episodes except evaluations, contested or not.
    pub tasks: Vec<PolicyVersionResults>,
}

/// Results of a policy version on a task.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct PolicyVersionResults {
    /// Id of the task.
    pub task: String,
    /// Number of finished episodes.
    pub episodes: i64,
    /// Number of successes among them.
    pub successes: i64,
    /// Success rate: successes / episodes.
    pub success: f64,
    /// Mean score of the episodes.
    pub score: f64,
    /// Time of the first report, RFC 3339.
    pub first_at: String,
    /// Time of the latest report, RFC 3339.
    pub last_at: String,
}

/// Page of policy versions.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct PolicyVersionPage {
    /// Versions of the page, newest first.
    pub versions: Vec<PolicyVersion>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Description of a policy version.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PolicyVersionDescription {
    /// Location of the weights in your own words: a path, a URL or a commit.
    #[schema(example = "checkpoints/step-1200")]
    pub checkpoint: Option<String>,
    /// Further notes of the trainer.
    pub notes: Option<String>,
}
