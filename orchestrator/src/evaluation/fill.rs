//! What comes in of an evaluation: groups that a trainer flew, and what the server flew by itself.

use crate::evaluation::results::{PolicyResults, EpisodeMeasures, measure_episode};
use crate::evaluation::suite::SuiteEntry;
use crate::evaluation::suite::file;
use crate::store::brackets::StoredOutcome;
use crate::store::evaluations::{self, EvaluationEntry};
use crate::store::groups::{GroupRow, GroupState};
use crate::store::keys::EpisodeSpan;
use crate::store::leases::{LeaseRow, Purpose};
use crate::store::{StoreError, episodes, from_json, to_json};
use crate::engine::error::ServiceError;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;

/// Takes a group that a trainer flew, where it is one of an evaluation: what is not complete is offered again.
pub(crate) async fn take(
    run: &mut RunTx<'_>,
    lease: &LeaseRow,
    group: &GroupRow,
) -> Result<(), ServiceError> {
    let RunTx { conn, now, .. } = run;
    let Some(of) = evaluations::of_group(conn, lease.id, group.number).await? else { return Ok(()) };
    if group.state != GroupState::Complete {
        return Ok(evaluations::offer_again(conn, of).await?);
    }
    let row = evaluations::get(conn, of.evaluation).await?;
    let suite = row.and_then(|row| file::built_in(&row.suite));
    let entry: Option<&'static SuiteEntry> =
        suite.and_then(|suite| suite.suite.entries().nth(usize::try_from(of.entry).ok()?));
    let Some(entry) = entry else {
        return Err(
            StoreError::corrupt("an evaluation", "its suite is not the one it was begun with").into()
        );
    };
    let from = group.number * lease.group_size;
    let span = EpisodeSpan { lease: lease.id, from, to: from + lease.group_size };
    let rows = episodes::finished_outcomes(conn, span).await?;
    let mut measured: Vec<EpisodeMeasures> = Vec::with_capacity(rows.len());
    for text in rows {
        let flown: StoredOutcome = from_json("an episode", &text)?;
        measured.push(measure_episode(entry, &flown.into()));
    }
    Ok(evaluations::store_episodes(conn, of, &to_json(&measured)?, *now).await?)
}

/// Whether an episode's lease flies an evaluation.
pub(crate) async fn is_of_one(
    tx: &mut WriteTx,
    lease: &LeaseRow,
    episode: i64,
) -> Result<bool, ServiceError> {
    let group = episode / lease.group_size.max(1);
    Ok(lease.purpose == Purpose::Eval && evaluations::of_group(&mut tx.conn, lease.id, group).await?.is_some())
}

/// Writes what the server flew.
#[derive(Debug)]
pub struct Fly {
    /// The evaluation.
    pub id: i64,
    /// What was flown, or why it could not be.
    pub flown: Result<PolicyResults, String>,
}

impl Change for Fly {
    type Output = ();
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let (now, conn) = (tx.now, &mut tx.conn);
        match self.flown {
            Err(trouble) => evaluations::fail(conn, self.id, &trouble).await?,
            Ok(flown) => {
                for (entry, episodes) in (0i64..).zip(&flown.episodes) {
                    let of = EvaluationEntry { evaluation: self.id, entry };
                    evaluations::store_episodes(conn, of, &to_json(episodes)?, now).await?;
                }
            }
        }
        Ok(())
    }
}
