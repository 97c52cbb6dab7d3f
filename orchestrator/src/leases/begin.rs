//! Begins groups of a lease with `disclosure: begin`: their scenarios are disclosed, and those that count become slots.

use store::group_slots;
use store::groups::{self, GroupRow, GroupState};
use store::ids::{LeaseId, RunId};
use store::leases::{Disclosure, LeaseRow, LeaseStatus};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::leases::create::GrantedLease;
use crate::leases::find::find_own_lease;
use crate::leases::slots::{GroupSlot, new_slots};
use crate::ownership::Actor;

/// Discloses groups of a lease. A group that is disclosed already stays as it is.
#[derive(Debug, Clone)]
pub struct BeginGroups {
    /// Id of the run.
    pub run: RunId,
    /// Id of the lease.
    pub lease: LeaseId,
    /// Numbers of the groups.
    pub groups: Vec<i64>,
    /// Actor that begins the groups.
    pub actor: Actor,
}

impl Change for BeginGroups {
    /// The lease, and the rows of the groups that were requested.
    type Output = GrantedLease;

    async fn apply(self, tx: &mut WriteTx) -> Result<GrantedLease, ServiceError> {
        let row = find_own_lease(&mut tx.conn, &self.run, &self.lease, self.actor).await?;
        let mut run = tx.run(self.run.as_str()).await?;
        check_lease(&row, &self.lease, run.lease_clock())?;
        if run.state.paused_at.is_some() {
            return Err(ServiceError::Paused(self.run.to_string()));
        }
        let mut rows = groups::get_many(run.conn, row.id, &self.groups).await?;
        rows.sort_by_key(|group| group.number);
        if let Some(unknown) = self.groups.iter().find(|number| rows.iter().all(|row| row.number != **number))
        {
            let reason =
                format!("has the group {unknown}, but the groups of the lease are 0 to {}", row.groups - 1);
            return Err(ServiceError::invalid("groups", reason));
        }
        let new: Vec<GroupRow> = (rows.iter())
            .filter(|group| !group.is_disclosed && group.state == GroupState::Open)
            .cloned()
            .collect();
        if !new.is_empty() {
            let later: Vec<GroupRow> = new.iter().filter(|group| !group.is_slot).cloned().collect();
            let slots = new_slots(&mut run, row.id, &later).await?;
            let numbers: Vec<i64> = new.iter().map(|group| group.number).collect();
            let slot_numbers: Vec<i64> = slots.iter().map(|slot| slot.number).collect();
            group_slots::disclose(run.conn, row.id, &numbers, &slot_numbers).await?;
            for group in rows.iter_mut().filter(|group| numbers.contains(&group.number)) {
                group.is_disclosed = true;
                group.is_slot |= slot_numbers.contains(&group.number);
            }
            let slots = slots.into_iter().map(|GroupSlot { slot, .. }| slot).collect();
            run.state.open_slots(run.conn, slots, run.now).await?;
        }
        rows.retain(|group| group.is_disclosed);
        Ok(GrantedLease { row, groups: rows, scenarios: None })
    }
}

/// Checks that groups of a lease can be begun.
fn check_lease(row: &LeaseRow, lease: &LeaseId, now: i64) -> Result<(), ServiceError> {
    if !row.is_active() || row.expires_at <= now {
        let status = if row.is_active() { LeaseStatus::Expired } else { row.status };
        return Err(ServiceError::LeaseClosed { lease: lease.to_string(), status });
    }
    if row.disclosure != Disclosure::Begin {
        let reason =
            "needs a lease with `disclosure: begin`; this lease disclosed its groups when it was created";
        return Err(ServiceError::invalid("groups", reason));
    }
    Ok(())
}
