//! Ends leases before all of their groups are closed: on request, or because their time is over.

use store::groups::{self, GroupState};
use store::ids::{LeaseId, RunId};
use store::leases::{self, LeaseRow, LeaseStatus};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::leases::find::find_lease;
use crate::metrics::LeaseEvent;
use crate::results::close::close_groups;
use crate::results::columns::settle;
use crate::results::report_summary::ReportSummary;

/// Leases that one change expires at most.
const MAX_EXPIRED_AT_ONCE: i64 = 32;

/// Releases a lease and closes its groups. The scenario of a lost group returns to the queue. Releasing twice is the same as releasing once.
#[derive(Debug)]
pub struct ReleaseLease {
    /// Id of the run.
    pub run: RunId,
    /// Id of the lease.
    pub lease: LeaseId,
}

impl Change for ReleaseLease {
    type Output = LeaseRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<LeaseRow, ServiceError> {
        let mut row = find_lease(&mut tx.conn, &self.run, &self.lease).await?;
        if row.is_active() {
            end_lease(tx, &row, LeaseEnd::Released).await?;
            row.status = LeaseStatus::Released;
        }
        Ok(row)
    }
}

/// Ends up to 32 leases whose time is over.
#[derive(Debug)]
pub struct ExpireLeases;

impl Change for ExpireLeases {
    /// Number of leases that were ended.
    type Output = usize;

    async fn apply(self, tx: &mut WriteTx) -> Result<usize, ServiceError> {
        let overdue = leases::overdue(&mut tx.conn, tx.now, MAX_EXPIRED_AT_ONCE).await?;
        for &id in &overdue {
            if let Some(row) = leases::get(&mut tx.conn, id).await? {
                end_lease(tx, &row, LeaseEnd::Expired).await?;
            }
        }
        Ok(overdue.len())
    }
}

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
    close_groups(&mut tx.run(&lease.run).await?, lease, groups).await
}
