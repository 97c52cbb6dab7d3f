//! Ends slots that keep later results waiting: a trainer that renews a lease for ever must not hold back the others.

use curriculum::StalledSlot;
use store::groups;
use store::leases::{self, LeaseRow};
use store::to_i64;

use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::leases::end_lease::{LeaseEnd, end_lease};
use crate::metrics::LeaseEvent;
use crate::results::close::close_groups;
use crate::results::report_summary::ReportSummary;

/// Number of results of later leases from which a slot is missing once the first lifetime of its lease is over.
pub(crate) const LATER_RESULTS: u32 = 64;
/// Number of results of later leases from which a slot is missing whatever the lifetime of its lease: as many results may wait.
const MAX_WAITING_RESULTS: u32 = 4096;

/// Closes the groups of a run for which too many later results wait. Episodes without a result are missing, and later reports of
/// them are late.
pub(crate) async fn close_stalled(tx: &mut WriteTx, run: &str) -> Result<ReportSummary, ServiceError> {
    let mut summary = ReportSummary::default();
    loop {
        let stalled = tx.run(run).await?.state.curriculum.stalled_slots(LATER_RESULTS);
        let mut has_closed = false;
        for slot in stalled {
            if let Some(closed) = close_if_overdue(tx, run, slot).await? {
                summary.add(closed);
                has_closed = true;
            }
        }
        if !has_closed {
            return Ok(summary);
        }
    }
}

/// Closes the group of a stalled slot if it is overdue; `None` if it is not.
async fn close_if_overdue(
    tx: &mut WriteTx,
    run: &str,
    slot: StalledSlot,
) -> Result<Option<ReportSummary>, ServiceError> {
    let mut run = tx.run(run).await?;
    let (id, clock) = (to_i64(slot.lease), run.lease_clock());
    if slot.later < MAX_WAITING_RESULTS && run.state.first_deadline(run.conn, id).await? > clock {
        return Ok(None);
    }
    let Some(lease) = leases::get(run.conn, id).await?.filter(LeaseRow::is_active) else { return Ok(None) };
    if lease.is_columns() {
        return end_lease(tx, &lease, LeaseEnd::Expired).await.map(Some);
    }
    let group = groups::open_of_proposal(run.conn, lease.id, to_i64(slot.key.proposal)).await?;
    let Some(group) = group else { return Ok(None) };
    let summary = close_groups(&mut run, &lease, vec![group]).await?;
    end_if_done(tx, &lease).await?;
    Ok(Some(summary))
}

/// Ends a lease whose groups are all closed.
pub(crate) async fn end_if_done(tx: &mut WriteTx, lease: &LeaseRow) -> Result<(), ServiceError> {
    if lease.is_active() && leases::end_if_done(&mut tx.conn, lease.id).await? {
        tx.emit(&lease.run, &RunEvent::lease(lease, LeaseEvent::Done))?;
    }
    Ok(())
}
