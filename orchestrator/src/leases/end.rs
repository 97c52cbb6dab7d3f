//! Ends leases before all of their groups are closed: on request, or because their time is over.

use store::ids::{LeaseId, RunId};
use store::leases::{self, LeaseRow, LeaseStatus};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::leases::end_lease::{LeaseEnd, end_lease};
use crate::leases::find::find_own_lease;
use crate::ownership::Actor;
use crate::results::stalled::close_stalled;

/// Leases that one change expires at most.
const MAX_EXPIRED_AT_ONCE: i64 = 32;

/// Releases a lease and closes its groups. The scenario of a lost group returns to the queue. Releasing twice is the same as releasing once.
#[derive(Debug)]
pub struct ReleaseLease {
    /// Id of the run.
    pub run: RunId,
    /// Id of the lease.
    pub lease: LeaseId,
    /// Client that the lease must belong to.
    pub actor: Actor,
}

impl Change for ReleaseLease {
    type Output = LeaseRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<LeaseRow, ServiceError> {
        let mut row = find_own_lease(&mut tx.conn, &self.run, &self.lease, self.actor).await?;
        if row.is_active() {
            end_lease(tx, &row, LeaseEnd::Released).await?;
            close_stalled(tx, &row.run).await?;
            row.status = LeaseStatus::Released;
        }
        Ok(row)
    }
}

/// Ends up to 32 leases whose time is over, and closes groups of renewed leases for which later results wait.
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
                close_stalled(tx, &row.run).await?;
            }
        }
        for run in leases::runs_with_renewed(&mut tx.conn, tx.now).await? {
            close_stalled(tx, &run).await?;
        }
        Ok(overdue.len())
    }
}
