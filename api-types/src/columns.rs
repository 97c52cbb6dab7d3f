//! Claims of a lease of columns, and their audit. The server alone reads the request, since it may be packed bytes.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Claim of a lease of columns, with the groups that are audited.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ColumnClaim {
    /// Id of the lease.
    pub lease: String,
    /// `claimed` (logs are due), `accepted`, `refused` or `unproven` (logs were never reported).
    pub state: String,
    /// Number of claimed episodes.
    pub episodes: i64,
    /// Number of claimed episodes that failed.
    pub failed: i64,
    /// Policy version that ran the episodes.
    pub policy_version: i64,
    /// Reason of a refusal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub why: Option<String>,
    /// Time until which the logs of audited groups are due as results, RFC 3339.
    pub due: String,
    /// Groups whose logs the server replays.
    pub audit: Vec<AuditedGroup>,
}

/// Group of a claim whose logs are due.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct AuditedGroup {
    /// Number of the group in the lease, from 0.
    pub group: i64,
    /// Indices of its finished episodes in the columns.
    pub entries: Vec<i64>,
    /// Ids under which to report these episodes, in the same order.
    pub episodes: Vec<String>,
}

/// Columns of a claim, as they were submitted.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ClaimedColumns {
    /// `claimed`, `accepted`, `refused` or `unproven`.
    pub state: String,
    /// Score of each episode of the lease.
    pub score: Vec<f32>,
    /// 1 for each failed episode, else 0; empty if no episode failed.
    pub failed: Vec<u8>,
    /// Number of steps of each episode; empty if it was not submitted.
    pub steps: Vec<u32>,
}
