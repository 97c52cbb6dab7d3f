//! Slots of leased groups: the groups whose results are evidence of mastery.

use store::group_slots;
use store::groups::{self, GroupRow, GroupState};
use store::leases;
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

/// Returns true if a group becomes a slot when a trainer can know the scenario. `is_first` says whether no trainer received it before.
pub(crate) fn is_slot(group: &GroupRow, proposal: &Proposal, is_first: bool) -> bool {
    group.is_mastery_evidence() && group.is_contested && is_first && can_show_mastery(proposal)
}

/// Returns true if scenarios of a proposal can show mastery of its level: they are drawn without selection, and start as hard as the
/// task has it.
pub(crate) fn can_show_mastery(proposal: &Proposal) -> bool {
    proposal.source.is_fresh() && proposal.has_full_start()
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

/// Makes slots of all groups that are leased and not disclosed: another run now has the same seed and shows their scenarios, so that
/// a trainer could begin only those that it likes.
pub(crate) async fn open_undisclosed(run: &mut RunTx<'_>) -> Result<(), ServiceError> {
    for lease in leases::active_with_begin(run.conn, &run.state.run).await? {
        let mut open = groups::of_lease(run.conn, lease).await?;
        open.retain(|group| group.state == GroupState::Open && !group.is_disclosed && !group.is_slot);
        let slots = new_slots(run, lease, &open).await?;
        let numbers: Vec<i64> = slots.iter().map(|slot| slot.number).collect();
        group_slots::set_slots(run.conn, lease, &numbers).await?;
        let slots = slots.into_iter().map(|GroupSlot { slot, .. }| slot).collect();
        run.state.open_slots(run.conn, slots, run.now).await?;
    }
    Ok(())
}
