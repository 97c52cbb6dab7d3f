//! Columns: results of all episodes of a lease in one request, and their audit.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Claim of a lease of columns, with the groups that are audited.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ColumnClaim {
    /// Id of the lease.
    pub lease: String,
    /// State of the claim.
    pub state: ClaimState,
    /// Number of claimed episodes.
    pub episodes: i64,
    /// Number of claimed episodes that failed.
    pub failed: i64,
    /// Policy version that ran the episodes.
    pub policy_version: i64,
    /// Reason of a refusal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Time until which the logs of audited groups are due as results, RFC 3339.
    pub due_at: String,
    /// Groups whose logs the server replays.
    pub audited_groups: Vec<AuditedGroup>,
}

/// Audited group of a claim: the trainer must report its logs.
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
    /// State of the claim.
    pub state: ClaimState,
    /// Score of each episode of the lease.
    pub score: Vec<f32>,
    /// 1 for each failed episode, else 0; empty if no episode failed.
    pub failed: Vec<u8>,
    /// Number of steps of each episode; empty if it was not submitted.
    pub steps: Vec<u32>,
}

/// State of a claim of columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ClaimState {
    /// Logs of the audited groups are due.
    Claimed,
    /// All audited logs replayed as claimed.
    Accepted,
    /// An audited log did not replay as claimed.
    Refused,
    /// Audited logs were not reported before the lease ended.
    Unproven,
}

/// Columns with one entry for each episode of the lease, in order. In MessagePack a column may also be `bin`: packed little-endian.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ColumnsRequest {
    /// Policy version that ran the episodes (default: the lease's).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy_version: Option<u32>,
    /// Score of each episode; a number is required for failed episodes too and ignored. `bin`: f32.
    pub score: Vec<f32>,
    /// 1 for each episode that the infrastructure lost, else 0; optional if none was lost. `bin`: u8.
    #[schema(value_type = Option<Vec<u8>>)]
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<u8>,
    /// Number of steps of each episode; optional. `bin`: u32.
    #[schema(value_type = Option<Vec<u32>>)]
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<u32>,
}
