//! Rows of groups that serve prepared proposals.

use store::from_json;
use store::groups::GroupRow;
use store::proposals::QueuedProposal;

use crate::engine::error::ServiceError;
use crate::engine::run_state::group_role;
use curriculum::Proposal;

/// Builds the row of a group that serves a prepared proposal. `is_evidence` says whether the group may count as evidence of mastery,
/// and `is_for_training` whether the trainer may learn from it.
pub(crate) fn proposed_group(
    number: i64,
    queued: QueuedProposal,
    is_evidence: bool,
    is_for_training: bool,
) -> Result<GroupRow, ServiceError> {
    let proposal: Proposal = from_json("a proposal", &queued.body)?;
    let scenario = queued.scenario.unwrap_or_default();
    Ok(GroupRow {
        proposal: Some(queued.seq),
        level: proposal.level.map(i64::from),
        is_contested: queued.is_contested.unwrap_or(false),
        is_evidence,
        is_for_training: proposal.train && is_for_training,
        ..GroupRow::open(number, group_role(proposal.role), proposal.task, scenario)
    })
}
