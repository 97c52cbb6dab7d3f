//! Leases of one group that workers of this server take, and give back where it went away in the middle.

use crate::leases::end::LeaseEnd;
use crate::ids::{LeaseId, RunId};
use crate::store::leases::{self, Purpose};
use crate::store::run_policies::{self, RunPolicy, RunPolicyRow};
use crate::store::to_u32;
use crate::leases::create::{CreateLease, GrantedLease};
use crate::leases::end::end_lease;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;


/// How long such a lease holds, seconds. It is renewed while it is flown.
pub const TTL_S: u32 = 600;

/// Takes a lease of one group for the policy that the run has at that moment.
#[derive(Debug, Clone)]
pub struct LeaseRolloutGroup {
    /// Of which run.
    pub run: RunId,
}

impl Change for LeaseRolloutGroup {
    /// The lease, and the policy that is to fly it; none while scenarios are still being prepared.
    type Output = Option<(LeaseId, RunPolicyRow)>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Self::Output, ServiceError> {
        let policy = run_policies::get(&mut tx.conn, self.run.as_str()).await?;
        let Some(policy) = policy.filter(|row| row.policy != RunPolicy::Off) else {
            return Err(ServiceError::Paused(self.run.to_string()));
        };
        let wish = CreateLease {
            run: self.run,
            groups: 1,
            group_size: None,
            policy_version: to_u32(policy.version),
            ttl_s: TTL_S,
            purpose: Purpose::Train,
            owner: None,
            refill: false,
            evaluation: None,
        };
        let Some(GrantedLease { row, .. }) = wish.apply(tx).await? else { return Ok(None) };
        run_policies::hold_lease(&mut tx.conn, row.id).await?;
        Ok(Some((row.lease_id(), policy)))
    }
}

/// Gives back a lease that a worker took.
#[derive(Debug)]
pub struct ReturnRolloutLease(pub LeaseId);

impl Change for ReturnRolloutLease {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        give_back(tx, self.0.number).await.map(|_| ())
    }
}

/// Gives back what was being flown when the server went away.
#[derive(Debug)]
pub struct ReturnAbandonedLeases;

impl Change for ReturnAbandonedLeases {
    /// How many leases.
    type Output = usize;

    async fn apply(self, tx: &mut WriteTx) -> Result<usize, ServiceError> {
        let mut given = 0;
        for lease in run_policies::held_leases(&mut tx.conn).await? {
            given += usize::from(give_back(tx, lease).await?);
        }
        Ok(given)
    }
}

/// Whether it was still held.
async fn give_back(tx: &mut WriteTx, lease: i64) -> Result<bool, ServiceError> {
    run_policies::release_lease(&mut tx.conn, lease).await?;
    let row = leases::get(&mut tx.conn, lease).await?.filter(|row| row.is_active());
    if let Some(row) = &row {
        end_lease(tx, row, LeaseEnd::Released).await?;
    }
    Ok(row.is_some())
}
