//! Trajectory feed of a run. The groups themselves are types of the server, which stores them as JSON.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// Query of the trajectory feed.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryQuery {
    /// Largest number of groups, from 1 to 256 (default 8). A response has at most 32 MiB of JSON, or a single group.
    pub limit: Option<u32>,
    /// Longest wait for the first group, seconds, from 0 to 60 (default 0).
    pub wait_s: Option<u32>,
    /// Duration of the claim, seconds, from 1 to 86 400 (default 600). A group that is not acknowledged by then is delivered again.
    pub ttl_s: Option<u32>,
    /// Id after which groups are read again without a claim, acknowledged or not.
    pub after: Option<u64>,
}

/// Acknowledgement of delivered groups.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AcknowledgeRequest {
    /// Ids of groups, at most 10 000.
    pub ids: Vec<u64>,
}

/// Response to an acknowledgement.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct AcknowledgeResponse {
    /// Ids of groups that are acknowledged, now or before.
    pub acked: Vec<i64>,
    /// Ids without a group in this run: they never existed or are no longer kept.
    pub unknown: Vec<i64>,
}
