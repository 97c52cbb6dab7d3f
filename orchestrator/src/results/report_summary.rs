//! Summary of a report: the groups it closed and their effects.

use api_types::{GroupReceipt, GroupRefill};
use curriculum::LevelMove;

/// Effects of the groups that a report closed.
#[derive(Debug, Default)]
pub struct ReportSummary {
    /// Level moves that the groups caused.
    pub moves: Vec<LevelMove>,
    /// The closed groups, except those of leases of columns.
    pub groups: Vec<GroupReceipt>,
    /// Groups that replace groups with zero variance.
    pub refills: Vec<GroupRefill>,
}

impl ReportSummary {
    /// Adds the effects of another summary.
    pub fn add(&mut self, other: Self) {
        self.moves.extend(other.moves);
        self.groups.extend(other.groups);
        self.refills.extend(other.refills);
    }
}
