//! Stores critiques: findings enter the failure profile of the run's task, and their jobs leave the queue in the same transaction.

use std::collections::{BTreeMap, BTreeSet};

use sqlx::SqliteConnection;
use store::{StoreError, critiques, layout_outcomes};

use crate::critiques::critique_result::CritiqueResult;
use crate::critiques::profile_cache::ProfileCache;
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;

/// Stores the results of critique jobs. A job that is no longer in the queue was stored before, and is ignored.
#[derive(Debug)]
pub struct StoreCritiques(pub Vec<CritiqueResult>);

impl Change for StoreCritiques {
    type Output = ();
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let mut by_task: BTreeMap<(String, String), Vec<CritiqueResult>> = BTreeMap::new();
        let ids: Vec<i64> = self.0.iter().map(|result| result.job.id).collect();
        let dequeued = critiques::dequeue(&mut tx.conn, &ids).await?;
        for result in self.0.into_iter().filter(|result| dequeued.contains(&result.job.id)) {
            by_task.entry((result.job.run.clone(), result.job.task.clone())).or_default().push(result);
        }
        for ((run_id, task), results) in by_task {
            let mut run = match tx.run(&run_id).await {
                Err(ServiceError::UnknownRun(_)) => continue, // it was deleted meanwhile
                run => run?,
            };
            let mut profile = match run.state.profiles.remove(&task) {
                Some(profile) => profile,
                None => ProfileCache::load(run.conn, &run_id, &task).await?,
            };
            profile.add(run.conn, run.now, &results).await?;
            add_layout_faults(run.conn, &results).await?;
            run.state.profiles.insert(task.clone(), profile);
            let findings = || results.iter().flat_map(|result| &result.findings);
            let mut modes = BTreeMap::new();
            for failure in findings().flat_map(|found| &found.failures) {
                *modes.entry(failure.key.mode.as_str()).or_default() += 1;
            }
            let criticised = findings().count();
            run.emit(&RunEvent::Failures { task: &task, criticised, modes })?;
        }
        Ok(())
    }
}

/// Counts the failure modes of episodes on designed layouts.
async fn add_layout_faults(
    conn: &mut SqliteConnection,
    results: &[CritiqueResult],
) -> Result<(), StoreError> {
    let mut by_layout: BTreeMap<i64, Vec<BTreeSet<&str>>> = BTreeMap::new();
    for found in results.iter().flat_map(|result| &result.findings).filter(|found| !found.failures.is_empty())
    {
        let Some(layout) = found.layout else { continue };
        let modes = found.failures.iter().map(|failure| failure.key.mode.as_str()).collect();
        by_layout.entry(layout).or_default().push(modes);
    }
    for (layout, episodes) in by_layout {
        layout_outcomes::add_failure_episodes(conn, layout, &episodes).await?;
    }
    Ok(())
}
