//! What groups that closed came to, for whoever reported their last episode.

use serde::Serialize;
use utoipa::ToSchema;

use curriculum::Move;

/// What closed groups came to.
#[derive(Debug, Default)]
pub struct Ended {
    /// Level moves that they caused.
    pub moves: Vec<Move>,
    /// The groups, but for those of leases of columns.
    pub groups: Vec<GroupEnd>,
    /// What was given in place of groups whose episodes all came to the same.
    pub refills: Vec<Refill>,
}

/// A group that closed.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct GroupEnd {
    /// Its lease.
    pub lease: String,
    /// Its number there.
    pub group: i64,
    /// `complete` (all of its episodes finished), `partial` (`min_group` or more of them did) or `lost`.
    pub state: String,
    /// Episodes that finished.
    pub finished: i64,
    /// Episodes that failed.
    pub failed: i64,
    /// Episodes that never came back.
    pub expired: i64,
    /// Of those that finished, successes.
    pub successes: i64,
    /// Mean score of those that finished.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_score: Option<f64>,
    /// Whether all that finished have the same score, so that there is nothing to learn from their differences; left out where fewer
    /// than two finished.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zero_variance: Option<bool>,
}

/// Groups that a lease was given in place of others: show the lease to have them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct Refill {
    /// The lease.
    pub lease: String,
    /// Their numbers there.
    pub groups: Vec<i64>,
}

impl Ended {
    /// Takes what others came to.
    pub fn add(&mut self, other: Self) {
        self.moves.extend(other.moves);
        self.groups.extend(other.groups);
        self.refills.extend(other.refills);
    }
}
