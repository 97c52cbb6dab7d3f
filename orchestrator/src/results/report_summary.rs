//! Summary of a report: the groups it closed and their effects.

use serde::Serialize;
use utoipa::ToSchema;

use crate::store::groups::GroupState;
use curriculum::LevelMove;

/// Effects of the groups that a report closed.
#[derive(Debug, Default)]
pub struct ReportSummary {
    /// Level moves that the groups caused.
    pub moves: Vec<LevelMove>,
    /// The closed groups, except those of leases of columns.
    pub groups: Vec<ClosedGroup>,
    /// Groups that replace groups with zero variance.
    pub refills: Vec<RefilledGroups>,
}

/// A closed group.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ClosedGroup {
    /// Id of its lease.
    pub lease: String,
    /// Number of the group in its lease, from 0.
    pub group: i64,
    /// `complete` (all episodes finished), `partial` (at least `min_group` episodes finished) or `lost`.
    #[schema(value_type = String)]
    pub state: GroupState,
    /// Number of finished episodes.
    pub finished: i64,
    /// Number of failed episodes.
    pub failed: i64,
    /// Number of episodes that were never reported.
    pub expired: i64,
    /// Number of successful episodes.
    pub successes: i64,
    /// Mean score of the finished episodes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_score: Option<f64>,
    /// True if all finished episodes have the same score, so that the group carries no learning signal. Left out if fewer than two
    /// episodes finished.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero_variance: Option<bool>,
}

/// Groups that were added to a lease in place of groups with zero variance. `GET` the lease to read them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct RefilledGroups {
    /// Id of the lease.
    pub lease: String,
    /// Numbers of the added groups in the lease.
    pub groups: Vec<i64>,
}

impl ReportSummary {
    /// Adds the effects of another summary.
    pub fn add(&mut self, other: Self) {
        self.moves.extend(other.moves);
        self.groups.extend(other.groups);
        self.refills.extend(other.refills);
    }
}
