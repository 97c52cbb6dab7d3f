//! The end of a lease before all of its groups are closed.

use store::groups::{self, GroupRow, GroupState};
use store::leases::{self, LeaseRow, LeaseStatus};
use store::{from_json, proposals, to_u64};

use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::metrics::LeaseEvent;
use crate::results::close::close_groups;
use crate::results::columns::settle;
use crate::results::report_summary::ReportSummary;
use curriculum::Proposal;

/// Reason why a lease ends before all of its groups are closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LeaseEnd {
    /// The client released it.
    Released,
    /// Its time is over.
    Expired,
}

/// Ends a lease and closes its open groups. The scenario of a lost group returns to the queue.
pub(crate) async fn end_lease(
    tx: &mut WriteTx,
    lease: &LeaseRow,
    end: LeaseEnd,
) -> Result<ReportSummary, ServiceError> {
    let (status, event) = match end {
        LeaseEnd::Released => (LeaseStatus::Released, LeaseEvent::Released),
        LeaseEnd::Expired => (LeaseStatus::Expired, LeaseEvent::Expired),
    };
    leases::set_status(&mut tx.conn, lease.id, status).await?;
    tx.emit(&lease.run, &RunEvent::lease(lease, event))?;
    if lease.is_columns() {
        settle::abandon(tx, lease).await?;
        return Ok(ReportSummary::default());
    }
    let mut groups = groups::of_lease(&mut tx.conn, lease.id).await?;
    groups.retain(|group| group.state == GroupState::Open);
    // A slot that was not disclosed is one of a run whose seed another run has: it is a lost attempt, like a disclosed group.
    let (seen, unseen): (Vec<_>, Vec<_>) =
        groups.into_iter().partition(|group| group.is_disclosed || group.is_slot);
    let mut run = tx.run(&lease.run).await?;
    return_unseen(&mut run, lease, unseen).await?;
    close_groups(&mut run, lease, seen).await
}

/// Returns groups that no trainer can have seen: their scenarios go to the front of the queue, as if they had not been leased.
pub(crate) async fn return_unseen(
    run: &mut RunTx<'_>,
    lease: &LeaseRow,
    mut unseen: Vec<GroupRow>,
) -> Result<(), ServiceError> {
    if unseen.is_empty() {
        return Ok(());
    }
    unseen.iter_mut().for_each(|group| group.state = GroupState::Lost);
    groups::update(run.conn, lease.id, &unseen, run.now).await?;
    let seqs: Vec<i64> = unseen.iter().filter_map(|group| group.proposal).collect();
    let (mut current, mut stale) = (Vec::new(), Vec::new());
    for leased in proposals::get_many(run.conn, &lease.run, &seqs).await? {
        let proposal: Proposal = from_json("a proposal", &leased.body)?;
        let is_current = run.state.curriculum.is_current(to_u64(leased.seq), &proposal);
        if is_current { current.push(leased.seq) } else { stale.push(leased.seq) }
    }
    proposals::return_unseen(run.conn, &lease.run, &current).await?;
    Ok(proposals::drop_all(run.conn, &lease.run, &stale).await?)
}
