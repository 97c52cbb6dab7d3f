//! Groups in place of those whose episodes all came to the same: from their differences there is nothing to learn.

use super::ended::Refill;
use super::lease::proposed_group;
use super::queue::{self, AHEAD};
use super::settings::EvidenceFrom;
use super::{TrainingError, Work};
use crate::store::groups;
use crate::store::leases::{self, LeaseRow};
use crate::store::{proposals, refills};

/// Owes a lease so many groups, and gives it what it is owed as far as scenarios are prepared.
pub(super) async fn owe(work: &mut Work, lease: &LeaseRow, flat: i64) -> Result<Vec<Refill>, TrainingError> {
    refills::owe(&mut work.conn, lease.id, flat).await?;
    give(work, &lease.run).await
}

/// Gives the leases of a run what they are owed, as far as scenarios are prepared.
pub(super) async fn give(work: &mut Work, run: &str) -> Result<Vec<Refill>, TrainingError> {
    let mut given = Vec::new();
    for (id, owed) in refills::owed(&mut work.conn, run).await? {
        let (mind, conn) = work.mind(run).await?;
        let evidence = mind.settings.evidence_from == EvidenceFrom::Train;
        let head = proposals::head(conn, run, owed).await?;
        let ready: Vec<_> = head.into_iter().take_while(|queued| queued.scenario.is_some()).collect();
        let Some(lease) = leases::get(conn, id).await?.filter(|_| !ready.is_empty()) else { break };
        let seqs: Vec<i64> = ready.iter().map(|queued| queued.seq).collect();
        proposals::leased(conn, run, &seqs).await?;
        let numbered = (lease.groups..).zip(ready);
        let rows = numbered.map(|(number, queued)| proposed_group(number, queued, (evidence, true)));
        let rows = rows.collect::<Result<Vec<_>, _>>()?;
        groups::insert(conn, id, &rows).await?;
        refills::given(conn, id, rows.len() as i64).await?;
        given.push(Refill { lease: lease.name(), groups: rows.iter().map(|row| row.number).collect() });
        queue::fill(work, run, AHEAD).await?;
    }
    Ok(given)
}
