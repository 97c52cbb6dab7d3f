//! Stores the results of evaluations: groups that a trainer reported, and suites that the server rolled out.

use store::brackets::StoredOutcome;
use store::evaluations::{self, EvaluationEntry};
use store::groups::{GroupRow, GroupState};
use store::keys::EpisodeSpan;
use store::leases::{LeaseRow, Purpose};
use store::{StoreError, episodes, from_json, to_json};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use evaluation::results::{EpisodeMeasures, PolicyResults, measure_episode};
use evaluation::suite::SuiteEntry;
use evaluation::suite::file;

/// Stores a group that a trainer reported, if it belongs to an evaluation. An incomplete group is offered again.
pub(crate) async fn store_reported_group(
    run: &mut RunTx<'_>,
    lease: &LeaseRow,
    group: &GroupRow,
) -> Result<(), ServiceError> {
    let RunTx { conn, now, .. } = run;
    let Some(key) = evaluations::of_group(conn, lease.id, group.number).await? else { return Ok(()) };
    if group.state != GroupState::Complete {
        return Ok(evaluations::offer_again(conn, key).await?);
    }
    let row = evaluations::get(conn, key.evaluation).await?;
    let suite = row.and_then(|row| file::built_in(&row.suite));
    let entry: Option<&'static SuiteEntry> =
        suite.and_then(|suite| suite.suite.entries().nth(usize::try_from(key.entry).ok()?));
    let Some(entry) = entry else {
        return Err(
            StoreError::corrupt("an evaluation", "its suite differs from the suite at its start").into()
        );
    };
    let from = group.number * lease.group_size;
    let span = EpisodeSpan { lease: lease.id, from, to: from + lease.group_size };
    let rows = episodes::finished_outcomes(conn, span).await?;
    let mut measures: Vec<EpisodeMeasures> = Vec::with_capacity(rows.len());
    for text in rows {
        let outcome: StoredOutcome = from_json("an episode", &text)?;
        measures.push(measure_episode(entry, &outcome.into()));
    }
    Ok(evaluations::store_episodes(conn, key, &to_json(&measures)?, *now).await?)
}

/// Returns true if an episode belongs to an evaluation.
pub(crate) async fn is_evaluation_episode(
    tx: &mut WriteTx,
    lease: &LeaseRow,
    episode: i64,
) -> Result<bool, ServiceError> {
    let group = episode / lease.group_size.max(1);
    Ok(lease.purpose == Purpose::Eval
        && evaluations::of_group(&mut tx.conn, lease.id, group).await?.is_some())
}

/// Stores the results of a suite that the server rolled out.
#[derive(Debug)]
pub struct StoreSuiteResults {
    /// Number of the evaluation.
    pub id: i64,
    /// Results by scenario, or why the rollout failed.
    pub results: Result<PolicyResults, String>,
}

impl Change for StoreSuiteResults {
    type Output = ();
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let (now, conn) = (tx.now, &mut tx.conn);
        match self.results {
            Err(error) => evaluations::fail(conn, self.id, &error).await?,
            Ok(results) => {
                for (entry, episodes) in (0i64..).zip(&results.episodes) {
                    let key = EvaluationEntry { evaluation: self.id, entry };
                    evaluations::store_episodes(conn, key, &to_json(episodes)?, now).await?;
                }
            }
        }
        Ok(())
    }
}
