//! Leases of one group that workers of this server take, and give back where it went away in the middle.

use crate::ids::{LeaseId, RunId};
use crate::store::leases;
use crate::store::policies::{self, PolicyRow};
use crate::store::small;
use crate::training::lease::{Granted, Purpose, TakeLease, end};
use crate::training::{Change, TrainingError, Work};

use super::settings::OFF;

/// How long such a lease holds, seconds. It is renewed while it is flown.
pub const TTL_S: u32 = 600;

/// Takes a lease of one group for the policy that the run has at that moment.
#[derive(Debug, Clone)]
pub struct TakeGroup {
    /// Of which run.
    pub run: RunId,
}

impl Change for TakeGroup {
    /// The lease, and the policy that is to fly it; none while scenarios are still being prepared.
    type Answer = Option<(LeaseId, PolicyRow)>;

    async fn apply(self, work: &mut Work) -> Result<Self::Answer, TrainingError> {
        let policy = policies::get(&mut work.conn, self.run.as_str()).await?;
        let Some(policy) = policy.filter(|row| row.policy != OFF) else {
            return Err(TrainingError::Paused(self.run.to_string()));
        };
        let wish = TakeLease {
            run: self.run,
            groups: 1,
            group_size: None,
            policy_version: small(policy.version),
            ttl_s: TTL_S,
            purpose: Purpose::Train,
            owner: None,
            refill: false,
            evaluation: None,
        };
        let Some(Granted { row, .. }) = wish.apply(work).await? else { return Ok(None) };
        policies::hold(&mut work.conn, row.id).await?;
        Ok(Some((row.lease_id(), policy)))
    }
}

/// Gives back a lease that a worker took.
#[derive(Debug)]
pub struct LetGo(pub LeaseId);

impl Change for LetGo {
    type Answer = ();

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        give_back(work, self.0.number).await.map(|_| ())
    }
}

/// Gives back what was being flown when the server went away.
#[derive(Debug)]
pub struct PickUp;

impl Change for PickUp {
    /// How many leases.
    type Answer = usize;

    async fn apply(self, work: &mut Work) -> Result<usize, TrainingError> {
        let mut given = 0;
        for lease in policies::held(&mut work.conn).await? {
            given += usize::from(give_back(work, lease).await?);
        }
        Ok(given)
    }
}

/// Whether it was still held.
async fn give_back(work: &mut Work, lease: i64) -> Result<bool, TrainingError> {
    policies::let_go(&mut work.conn, lease).await?;
    let row = leases::get(&mut work.conn, lease).await?.filter(|row| row.status == "active");
    if let Some(row) = &row {
        end(work, row, "released").await?;
    }
    Ok(row.is_some())
}
