//! Renews a lease before it expires.

use store::ids::{LeaseId, RunId};
use store::leases::{self, LeaseRow, LeaseStatus};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::leases::find::find_own_lease;
use crate::metrics::LeaseEvent;
use crate::ownership::Actor;
use crate::results::columns::status::is_claimed;

/// Extends an active lease by its duration, from now.
#[derive(Debug)]
pub struct RenewLease {
    /// Id of the run.
    pub run: RunId,
    /// Id of the lease.
    pub lease: LeaseId,
    /// Client that the lease must belong to.
    pub actor: Actor,
}

impl Change for RenewLease {
    type Output = LeaseRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<LeaseRow, ServiceError> {
        let mut row = find_own_lease(&mut tx.conn, &self.run, &self.lease, self.actor).await?;
        let clock = tx.run(&row.run).await?.lease_clock();
        if !row.is_active() || row.expires_at <= clock {
            let status = if row.is_active() { LeaseStatus::Expired } else { row.status };
            return Err(ServiceError::LeaseClosed { lease: self.lease.to_string(), status });
        }
        if row.is_columns() && is_claimed(&mut tx.conn, row.id).await? {
            // A trainer that knows which groups are audited must not gain time to fly them until they fit its claim.
            return Err(ServiceError::AuditDue(self.lease.to_string()));
        }
        row.expires_at = clock + row.ttl_ms;
        leases::set_expiry(&mut tx.conn, row.id, row.expires_at).await?;
        tx.emit(&row.run, &RunEvent::lease(&row, LeaseEvent::Renewed))?;
        Ok(row)
    }
}
