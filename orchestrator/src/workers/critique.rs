//! Criticises episodes that were reported, behind the acknowledgement and behind everything else that wants the machine.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use rayon::prelude::*;
use sqlx::SqlitePool;
use tokio::sync::Notify;

use crate::counts;
use crate::store::critiques;
use crate::training::criticise::{self, Done, Enter, Material};
use crate::training::{TrainingError, Writer, sample};

/// Jobs looked at at a time.
const JOBS: i64 = 64;
/// How long it waits after a failure, and at most for a wake-up that was missed.
const PAUSE: Duration = Duration::from_secs(2);

/// What the worker needs.
#[derive(Debug, Clone)]
pub struct Critic {
    /// Where episodes are read.
    pub readers: SqlitePool,
    /// Where profiles are written.
    pub writer: Writer,
    /// Rung when episodes were reported.
    pub wake: Arc<Notify>,
    /// Threads of its own, in the background.
    pub pool: Arc<rayon::ThreadPool>,
}

impl Critic {
    /// Works until the writer is gone.
    pub async fn run(self) {
        let mut sampled = BTreeSet::new();
        loop {
            match self.batch(&mut sampled).await {
                Ok(0) => {
                    let _ = tokio::time::timeout(PAUSE, self.wake.notified()).await;
                }
                Ok(_) => {}
                Err(TrainingError::Stopping) => return,
                // Whoever fills the queue of changes comes first.
                Err(TrainingError::Busy) => tokio::time::sleep(PAUSE).await,
                Err(error) => {
                    tracing::error!(error = %error, "Episodes could not be criticised; trying again soon.");
                    tokio::time::sleep(PAUSE).await;
                }
            }
        }
    }

    /// Does the jobs that have waited longest; how many.
    async fn batch(&self, sampled: &mut BTreeSet<String>) -> Result<usize, TrainingError> {
        let _busy = counts::Busy::with("critique");
        let material = self.load(sampled).await?;
        let count = material.len();
        if count == 0 {
            return Ok(0);
        }
        let pool = Arc::clone(&self.pool);
        let done: Vec<Done> = tokio::task::spawn_blocking(move || {
            pool.install(|| material.into_par_iter().map(criticise::criticise).collect())
        })
        .await
        .map_err(|error| TrainingError::invalid("critique", error.to_string()))?;
        let failures: Vec<_> = done.iter().filter_map(told).collect();
        self.writer.change(Enter(done)).await?;
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

    async fn load(&self, sampled: &mut BTreeSet<String>) -> Result<Vec<Material>, TrainingError> {
        let mut conn = self.readers.acquire().await?;
        let jobs = critiques::jobs(&mut conn, JOBS).await?;
        if jobs.is_empty() && sampled.is_empty() {
            return Ok(Vec::new());
        }
        let waiting = critiques::waiting(&mut conn).await?;
        let halvings: BTreeMap<String, u32> =
            waiting.iter().map(|(run, waiting)| (run.clone(), sample::halvings(*waiting))).collect();
        tell(sampled, &waiting);
        Ok(criticise::load(&mut conn, jobs, &halvings).await?)
    }
}

fn told(done: &Done) -> Option<(String, i64, i64, String)> {
    let reason = done.reason.clone()?;
    Some((done.job.run.clone(), done.job.lease, done.failed, reason))
}

/// Says when sampling of a run begins, and when it ends.
fn tell(sampled: &mut BTreeSet<String>, waiting: &[(String, i64)]) {
    let of = |run: &str| waiting.iter().find(|(r, _)| r == run).map_or(0, |(_, waiting)| *waiting);
    for (run, waiting) in waiting {
        if sample::halvings(*waiting) > 0 && sampled.insert(run.clone()) {
            tracing::info!(
                run,
                waiting,
                "More episodes wait for their critique than it keeps up with; only some are criticised."
            );
        }
    }
    sampled.retain(|run| {
        let on = of(run) > sample::PATIENCE / 2;
        if !on {
            tracing::info!(run, "The critique has caught up; every episode is criticised again.");
        }
        on
    });
}
