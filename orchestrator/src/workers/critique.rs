//! Criticises episodes that were reported, behind the acknowledgement and behind everything else that wants the machine.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use rayon::prelude::*;
use sqlx::SqlitePool;
use tokio::sync::Notify;

use crate::metrics;
use crate::store::critiques;
use crate::critiques::criticise;
use crate::critiques::criticise::{CritiqueResult, StoreCritiques};
use crate::critiques::critique_input::{self, CritiqueInput};
use crate::critiques::sampling;
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;

/// Jobs looked at at a time.
const JOBS: i64 = 64;
/// How long it waits after a failure, and at most for a wake-up that was missed.
const PAUSE: Duration = Duration::from_secs(2);

/// What the worker needs.
#[derive(Debug, Clone)]
pub struct CritiqueWorker {
    /// Where episodes are read.
    pub readers: SqlitePool,
    /// Where profiles are written.
    pub writer: Writer,
    /// Rung when episodes were reported.
    pub wake: Arc<Notify>,
    /// Threads of its own, in the background.
    pub pool: Arc<rayon::ThreadPool>,
}

impl CritiqueWorker {
    /// Works until the writer is gone.
    pub async fn run(self) {
        let mut sampled = BTreeSet::new();
        loop {
            match self.batch(&mut sampled).await {
                Ok(0) => {
                    let _ = tokio::time::timeout(PAUSE, self.wake.notified()).await;
                }
                Ok(_) => {}
                Err(ServiceError::Stopping) => return,
                // Whoever fills the queue of changes comes first.
                Err(ServiceError::Busy) => tokio::time::sleep(PAUSE).await,
                Err(error) => {
                    tracing::error!(error = %error, "Episodes could not be criticised; trying again soon.");
                    tokio::time::sleep(PAUSE).await;
                }
            }
        }
    }

    /// Does the jobs that have waited longest; how many.
    async fn batch(&self, sampled: &mut BTreeSet<String>) -> Result<usize, ServiceError> {
        let _busy = metrics::BusyGuard::new("critique");
        let material = self.load(sampled).await?;
        let count = material.len();
        if count == 0 {
            return Ok(0);
        }
        let pool = Arc::clone(&self.pool);
        let done: Vec<CritiqueResult> = tokio::task::spawn_blocking(move || {
            pool.install(|| material.into_par_iter().map(criticise::criticise).collect())
        })
        .await
        .map_err(|error| ServiceError::invalid("critique", error.to_string()))?;
        let failures: Vec<_> = done.iter().filter_map(told).collect();
        self.writer.change(StoreCritiques(done)).await?;
        for (run, lease, failed, reason) in failures {
            tracing::warn!(
                run,
                lease,
                failed,
                reason,
                "Episodes cannot be criticised and are counted as failed."
            );
        }
        Ok(count)
    }

    async fn load(&self, sampled: &mut BTreeSet<String>) -> Result<Vec<CritiqueInput>, ServiceError> {
        let mut conn = self.readers.acquire().await?;
        let jobs = critiques::oldest(&mut conn, JOBS).await?;
        if jobs.is_empty() && sampled.is_empty() {
            return Ok(Vec::new());
        }
        let waiting = critiques::waiting_by_run(&mut conn).await?;
        let halvings: BTreeMap<String, u32> =
            waiting.iter().map(|(run, waiting)| (run.clone(), sampling::halvings(*waiting))).collect();
        tell(sampled, &waiting);
        Ok(critique_input::load(&mut conn, jobs, &halvings).await?)
    }
}

fn told(done: &CritiqueResult) -> Option<(String, i64, i64, String)> {
    let reason = done.reason.clone()?;
    Some((done.job.run.clone(), done.job.lease, done.failed, reason))
}

/// Says when sampling of a run begins, and when it ends.
fn tell(sampled: &mut BTreeSet<String>, waiting: &BTreeMap<String, i64>) {
    let of = |run: &str| waiting.get(run).copied().unwrap_or(0);
    for (run, waiting) in waiting {
        if sampling::halvings(*waiting) > 0 && sampled.insert(run.clone()) {
            tracing::info!(
                run,
                waiting,
                "More episodes wait for their critique than it keeps up with; only some are criticised."
            );
        }
    }
    sampled.retain(|run| {
        let on = of(run) > sampling::PATIENCE / 2;
        if !on {
            tracing::info!(run, "The critique has caught up; every episode is criticised again.");
        }
        on
    });
}
