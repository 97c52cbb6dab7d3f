//! Leases of one group that the server's own rollout workers take, and return after an interruption.

use store::groups::{self, GroupState};
use store::ids::{LeaseId, RunId};
use store::leases::{self, Disclosure, LeaseRow, LeaseStatus, Purpose};
use store::run_policies::{self, RunPolicy, RunPolicyRow};
use store::to_u32;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::leases::create::{CreateLease, GrantedLease, OwnerQuota};
use crate::leases::end_lease::{LeaseEnd, end_lease, return_unseen};
use crate::leases::slots::new_slots;
use crate::metrics::LeaseEvent;
use crate::results::observe::withdraw;

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
            owner: Some(OwnerQuota::SERVER),
            refill: false,
            evaluation: None,
            disclosure: Disclosure::Lease,
        };
        let Some(GrantedLease { row, .. }) = request.apply(tx).await? else { return Ok(None) };
        run_policies::hold_lease(&mut tx.conn, row.id).await?;
        Ok(Some(RolloutLease { lease: row.lease_id(), policy }))
    }
}

/// Returns a lease of a rollout worker whose policy failed: episodes without a result are missing, and scenarios of lost groups return
/// to the queue.
#[derive(Debug)]
pub struct ReturnRolloutLease(pub LeaseId);

impl Change for ReturnRolloutLease {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        if let Some(row) = release_held(tx, self.0.number).await? {
            end_lease(tx, &row, LeaseEnd::Released).await?;
        }
        Ok(())
    }
}

/// Returns a lease of a rollout worker without a loss: its group was not rolled out, and its scenario goes to the front of the queue.
#[derive(Debug)]
pub struct WithdrawRolloutLease(pub LeaseId);

impl Change for WithdrawRolloutLease {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        return_lease(tx, self.0.number).await?;
        Ok(())
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

/// Forgets that a worker holds a lease, and returns the lease if it is active.
async fn release_held(tx: &mut WriteTx, lease: i64) -> Result<Option<LeaseRow>, ServiceError> {
    run_policies::release_lease(&mut tx.conn, lease).await?;
    Ok(leases::get(&mut tx.conn, lease).await?.filter(LeaseRow::is_active))
}

/// Returns a lease whose group was not rolled out; true if it was still active. No trainer saw its groups, and the
/// server rolls them out again: their slots are withdrawn, and their scenarios go to the front of the queue.
async fn return_lease(tx: &mut WriteTx, lease: i64) -> Result<bool, ServiceError> {
    let Some(row) = release_held(tx, lease).await? else { return Ok(false) };
    leases::set_status(&mut tx.conn, row.id, LeaseStatus::Released).await?;
    tx.emit(&row.run, &RunEvent::lease(&row, LeaseEvent::Released))?;
    let mut groups = groups::of_lease(&mut tx.conn, row.id).await?;
    groups.retain(|group| group.state == GroupState::Open);
    let mut run = tx.run(&row.run).await?;
    let slots = new_slots(&mut run, row.id, &groups).await?.into_iter().map(|of| of.slot).collect();
    withdraw(&mut run, slots).await?;
    return_unseen(&mut run, &row, groups).await?;
    Ok(true)
}
