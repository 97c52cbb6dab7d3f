//! State of the policy that the server runs for a run.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Fill level of a trajectory feed.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct FeedStatus {
    /// Number of groups that wait to be delivered.
    pub waiting: i64,
    /// Number of delivered groups whose claim has not expired.
    pub delivered: i64,
    /// Number of acknowledged groups that can still be read again.
    pub acked: i64,
    /// Size of the unacknowledged groups as stored, bytes.
    pub bytes: i64,
    /// True if no more groups are run until some are acknowledged.
    pub full: bool,
}

/// Latest error of a run's policy.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct PolicyFault {
    /// Description in one sentence.
    pub words: String,
    /// Time of the error, RFC 3339.
    pub at: String,
}
