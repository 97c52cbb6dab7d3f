//! Slots of leased groups: the groups whose results are evidence of mastery.

use store::groups::GroupRow;
use store::proposals::{self, LeasedProposal};
use store::{from_json, to_u64};

use crate::engine::error::ServiceError;
use crate::engine::run_tx::RunTx;
use curriculum::{Proposal, Slot};

/// Builds the slot of a group that serves a proposal. `group` is its number in a lease of columns, else 0.
pub(crate) fn slot_of(lease: i64, seq: i64, group: u32, proposal: &Proposal) -> Slot {
    Slot {
        proposal: to_u64(seq),
        group,
        lease: to_u64(lease),
        task: proposal.task.clone(),
        level: proposal.level,
        epoch: proposal.epoch,
        role: proposal.role,
    }
}

/// Returns true if a group is a slot when its trainer receives the scenario. `is_first` says whether no trainer received it before.
pub(crate) const fn is_slot(group: &GroupRow, proposal: &Proposal, is_first: bool) -> bool {
    group.is_evidence && group.is_contested && is_first && proposal.source.is_fresh()
}

/// A group of a lease with the slot that it is or may become.
pub(crate) struct GroupSlot {
    /// Number of the group in the lease.
    pub(crate) number: i64,
    /// Slot of the group.
    pub(crate) slot: Slot,
}

/// Returns the slots of groups of a lease that are disclosed now.
pub(crate) async fn new_slots(
    run: &mut RunTx<'_>,
    lease: i64,
    groups: &[GroupRow],
) -> Result<Vec<GroupSlot>, ServiceError> {
    let seqs: Vec<i64> = groups.iter().filter_map(|group| group.proposal).collect();
    let mut slots = Vec::new();
    for LeasedProposal { seq, body, attempts } in proposals::get_many(run.conn, &run.state.run, &seqs).await?
    {
        let proposal: Proposal = from_json("a proposal", &body)?;
        let Some(group) = groups.iter().find(|group| group.proposal == Some(seq)) else { continue };
        if is_slot(group, &proposal, attempts <= 1) {
            slots.push(GroupSlot { number: group.number, slot: slot_of(lease, seq, 0, &proposal) });
        }
    }
    Ok(slots)
}
