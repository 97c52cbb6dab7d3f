//! Slots: the groups whose results are evidence of mastery.

use serde::{Deserialize, Serialize};

use super::proposal::ProposalRole;

/// Group whose result is evidence of mastery. It becomes a slot before its trainer sees the scenario, and no later
/// report removes it: episodes without a result are missing, and a missing result is counted at its worst.
///
/// A group is a slot if its scenario is fresh and contested, if the purpose of its lease counts, and if it is the first
/// attempt at the scenario.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Slot {
    /// Seq of the proposal.
    pub proposal: u64,
    /// Number of the group in a lease of columns. It is 0 in a lease of groups, which has one group for a proposal.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub group: u32,
    /// Number of the lease. Later leases have higher numbers.
    pub lease: u64,
    /// Task of the proposal.
    pub task: String,
    /// Level of the proposal.
    pub level: Option<u32>,
    /// Epoch of the proposal.
    pub epoch: u32,
    /// Role of the proposal.
    pub role: ProposalRole,
}

impl Slot {
    /// Key of the slot.
    #[must_use]
    pub const fn key(&self) -> SlotKey {
        SlotKey { proposal: self.proposal, group: self.group }
    }
}

/// Key of a slot in its run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct SlotKey {
    /// Seq of the proposal.
    pub proposal: u64,
    /// Number of the group in a lease of columns, else 0.
    pub group: u32,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
pub(super) const fn is_zero(value: &u32) -> bool {
    *value == 0
}

/// Slot without a result that keeps later slots waiting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StalledSlot {
    /// Key of the slot.
    pub key: SlotKey,
    /// Number of the slot's lease.
    pub lease: u64,
    /// Number of slots of later leases that have their result and wait for this slot.
    pub later: u32,
}
