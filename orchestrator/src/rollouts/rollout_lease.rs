//! Leases of one group that the server's own rollout workers take, and return after an interruption.

use store::ids::{LeaseId, RunId};
use store::leases::{self, Purpose};
use store::run_policies::{self, RunPolicy, RunPolicyRow};
use store::to_u32;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::leases::create::{CreateLease, GrantedLease};
use crate::leases::end::{LeaseEnd, end_lease};

/// Lifetime of a rollout lease, in seconds. It is renewed while its group is rolled out.
pub const ROLLOUT_TTL_S: u32 = 600;

/// Leases one group for the policy that the run has at that moment.
#[derive(Debug, Clone)]
pub struct LeaseRolloutGroup {
    /// Id of the run.
    pub run: RunId,
}

/// A lease of one group, and the policy that it was taken for.
#[derive(Debug, Clone)]
pub struct RolloutLease {
    /// Id of the lease.
    pub lease: LeaseId,
    /// The run's policy when the lease was taken.
    pub policy: RunPolicyRow,
}

impl Change for LeaseRolloutGroup {
    /// `None` while scenarios are still being prepared.
    type Output = Option<RolloutLease>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Option<RolloutLease>, ServiceError> {
        let policy = run_policies::get(&mut tx.conn, self.run.as_str()).await?;
        let Some(policy) = policy.filter(|row| row.policy != RunPolicy::Off) else {
            return Err(ServiceError::Paused(self.run.to_string()));
        };
        let request = CreateLease {
            run: self.run,
            groups: 1,
            group_size: None,
            policy_version: to_u32(policy.version),
            ttl_s: ROLLOUT_TTL_S,
            purpose: Purpose::Train,
            owner: None,
            refill: false,
            evaluation: None,
        };
        let Some(GrantedLease { row, .. }) = request.apply(tx).await? else { return Ok(None) };
        run_policies::hold_lease(&mut tx.conn, row.id).await?;
        Ok(Some(RolloutLease { lease: row.lease_id(), policy }))
    }
}

/// Returns a lease of a rollout worker: scenarios of lost groups return to the queue.
#[derive(Debug)]
pub struct ReturnRolloutLease(pub LeaseId);

impl Change for ReturnRolloutLease {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        return_lease(tx, self.0.number).await.map(|_| ())
    }
}

/// Returns the leases that rollout workers held when the server stopped.
#[derive(Debug)]
pub struct ReturnAbandonedLeases;

impl Change for ReturnAbandonedLeases {
    /// Number of leases that were still active.
    type Output = usize;

    async fn apply(self, tx: &mut WriteTx) -> Result<usize, ServiceError> {
        let mut returned = 0;
        for lease in run_policies::held_leases(&mut tx.conn).await? {
            returned += usize::from(return_lease(tx, lease).await?);
        }
        Ok(returned)
    }
}

/// Returns a lease; true if it was still active.
async fn return_lease(tx: &mut WriteTx, lease: i64) -> Result<bool, ServiceError> {
    run_policies::release_lease(&mut tx.conn, lease).await?;
    let row = leases::get(&mut tx.conn, lease).await?.filter(|row| row.is_active());
    if let Some(row) = &row {
        end_lease(tx, row, LeaseEnd::Released).await?;
    }
    Ok(row.is_some())
}
