//! Rows of groups that serve prepared proposals.

use store::from_json;
use store::groups::GroupRow;
use store::leases::Disclosure;
use store::proposals::QueuedProposal;

use crate::engine::error::ServiceError;
use crate::engine::run_state::group_role;
use crate::leases::slots::{is_slot, slot_of};
use curriculum::{Proposal, Slot};

/// How the groups of a lease count and are disclosed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroupTerms {
    /// Number of the lease.
    pub(crate) lease: i64,
    /// True if the purpose of the lease counts.
    pub(crate) is_evidence: bool,
    /// True if the trainer may learn from the groups.
    pub(crate) is_for_training: bool,
    /// When the scenarios are disclosed.
    pub(crate) disclosure: Disclosure,
    /// True if another run has the seed of this one, so that a trainer may know the scenarios before they are disclosed.
    pub(crate) is_seed_reused: bool,
}

/// Row of a group, and its slot if the group is one from the start.
pub(crate) struct ProposedGroup {
    pub(crate) row: GroupRow,
    pub(crate) slot: Option<Slot>,
}

/// Builds the row of a group that serves a prepared proposal.
pub(crate) fn proposed_group(
    number: i64,
    queued: QueuedProposal,
    terms: GroupTerms,
) -> Result<ProposedGroup, ServiceError> {
    let proposal: Proposal = from_json("a proposal", &queued.body)?;
    let scenario = queued.scenario.unwrap_or_default();
    let mut row = GroupRow {
        proposal: Some(queued.seq),
        level: proposal.level.map(i64::from),
        is_contested: queued.is_contested.unwrap_or(false),
        is_evidence: terms.is_evidence,
        is_for_training: proposal.train && terms.is_for_training,
        is_disclosed: terms.disclosure == Disclosure::Lease,
        ..GroupRow::open(number, group_role(proposal.role), proposal.task.clone(), scenario)
    };
    // A group whose scenario no trainer can know yet becomes a slot when it is disclosed.
    row.is_slot =
        (row.is_disclosed || terms.is_seed_reused) && is_slot(&row, &proposal, queued.attempts == 0);
    let slot = row.is_slot.then(|| slot_of(terms.lease, queued.seq, 0, &proposal));
    Ok(ProposedGroup { row, slot })
}
