//! Replaces groups with zero variance: a trainer learns nothing from a group whose episodes all have the same score.

use api_types::{EvidenceFrom, GroupRefill};
use store::leases::{self, LeaseRow};
use store::refills::{self, PendingRefill};
use store::{groups, proposals};

use crate::engine::error::ServiceError;
use crate::engine::run_tx::RunTx;
use crate::leases::group_row::{GroupTerms, ProposedGroup, proposed_group};
use crate::leases::proposal_queue;

/// Adds `count` groups to what a lease is owed, and grants what is owed as far as scenarios are prepared.
pub(crate) async fn request_refill(
    run: &mut RunTx<'_>,
    lease: &LeaseRow,
    count: i64,
) -> Result<Vec<GroupRefill>, ServiceError> {
    refills::add_pending(run.conn, lease.id, count).await?;
    grant_refills(run).await
}

/// Grants the leases of a run the groups they are owed, as far as scenarios are prepared.
pub(crate) async fn grant_refills(run: &mut RunTx<'_>) -> Result<Vec<GroupRefill>, ServiceError> {
    let mut granted = Vec::new();
    for PendingRefill { lease: id, groups: owed } in refills::pending(run.conn, &run.state.run).await? {
        let is_evidence = run.state.settings.evidence_from == EvidenceFrom::Train;
        let head = proposals::head(run.conn, &run.state.run, owed).await?;
        let ready: Vec<_> = head.into_iter().take_while(|queued| queued.scenario.is_some()).collect();
        let Some(lease) = leases::get(run.conn, id).await?.filter(|_| !ready.is_empty()) else { break };
        let seqs: Vec<i64> = ready.iter().map(|queued| queued.seq).collect();
        proposals::set_leased(run.conn, &run.state.run, &seqs).await?;
        let terms = GroupTerms {
            lease: id,
            is_evidence,
            is_for_training: true,
            disclosure: lease.disclosure,
            is_seed_reused: run.state.is_seed_reused,
        };
        let (mut rows, mut slots) = (Vec::new(), Vec::new());
        for (number, queued) in (lease.groups..).zip(ready) {
            let ProposedGroup { row, slot } = proposed_group(number, queued, terms)?;
            rows.push(row);
            slots.extend(slot);
        }
        groups::insert(run.conn, id, &rows).await?;
        run.state.open_slots(run.conn, slots, run.now).await?;
        refills::add_given(run.conn, PendingRefill { lease: id, groups: rows.len() as i64 }).await?;
        granted
            .push(GroupRefill { lease: lease.name(), groups: rows.iter().map(|row| row.number).collect() });
        proposal_queue::fill(run).await?;
    }
    Ok(granted)
}
