//! Criticises reported episodes, after their acknowledgement and at a lower priority than all other work.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use job_queue::{CompletedJob, JobError, JobQueue};
use jobs::{JobOutput, JobPayload};
use sqlx::SqlitePool;
use store::critiques;
use tokio::sync::Notify;

use crate::critiques::criticise::PendingCritiques;
use crate::critiques::critique_input::{self, CritiqueInput};
use crate::critiques::critique_result::CritiqueResult;
use crate::critiques::sampling;
use crate::critiques::store_critiques::StoreCritiques;
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::metrics;
use crate::workers::round_error::ends_worker;

/// Maximum number of jobs in a batch.
const BATCH_JOBS: i64 = 64;
/// Pause after an error, and maximum wait for a signal, in case one was missed.
const PAUSE: Duration = Duration::from_secs(2);

/// Worker that criticises reported episodes.
#[derive(Debug, Clone)]
pub(super) struct CritiqueWorker {
    /// Pool of connections that read.
    pub readers: SqlitePool,
    /// Handle to the one writer.
    pub writer: Writer,
    /// Signal that episodes were reported.
    pub wake: Arc<Notify>,
    /// Queue that criticises, at background priority.
    pub queue: Arc<dyn JobQueue>,
}

impl CritiqueWorker {
    /// Runs until the writer stops.
    pub(super) async fn run(self) {
        let mut sampled = BTreeSet::new();
        loop {
            match self.criticise_batch(&mut sampled).await {
                Ok(0) => {
                    let _ = tokio::time::timeout(PAUSE, self.wake.notified()).await;
                }
                Ok(_) => {}
                Err(error) if ends_worker(&error, "episodes could not be criticised") => return,
                Err(_) => tokio::time::sleep(PAUSE).await,
            }
        }
    }

    /// Criticises the jobs that have waited longest. Returns their number.
    async fn criticise_batch(&self, sampled: &mut BTreeSet<String>) -> Result<usize, ServiceError> {
        let _busy = metrics::BusyGuard::new("critique");
        let inputs = self.load_inputs(sampled).await?;
        let count = inputs.len();
        if count == 0 {
            return Ok(0);
        }
        let (pending, batch) = PendingCritiques::take_episodes(inputs);
        let done = self.queue.run(JobPayload::Critique(batch)).await;
        let done = done.map_err(|error| ServiceError::invalid("critique", error.to_string()))?;
        let CompletedJob { output: JobOutput::Critique(output), receipt } = done else {
            return Err(ServiceError::invalid("critique", JobError::OtherKind.to_string()));
        };
        let results: Vec<CritiqueResult> = pending.finish(output);
        let failures: Vec<_> = results.iter().filter_map(JobFailure::of).collect();
        self.writer.change(StoreCritiques(results)).await?;
        receipt.acknowledge();
        for JobFailure { run, lease, failed, reason } in failures {
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

    /// Loads the oldest jobs. In runs with a long backlog only a sample is criticised.
    async fn load_inputs(&self, sampled: &mut BTreeSet<String>) -> Result<Vec<CritiqueInput>, ServiceError> {
        let mut conn = self.readers.acquire().await?;
        let jobs = critiques::oldest(&mut conn, BATCH_JOBS).await?;
        if jobs.is_empty() && sampled.is_empty() {
            return Ok(Vec::new());
        }
        let waiting = critiques::waiting_by_run(&mut conn).await?;
        let halvings: BTreeMap<String, u32> =
            waiting.iter().map(|(run, waiting)| (run.clone(), sampling::halvings(*waiting))).collect();
        log_sampling(sampled, &waiting);
        Ok(critique_input::load(&mut conn, jobs, &halvings).await?)
    }
}

/// Episodes of a job that could not be criticised.
struct JobFailure {
    run: String,
    lease: i64,
    /// Number of the episodes.
    failed: i64,
    reason: String,
}

impl JobFailure {
    fn of(result: &CritiqueResult) -> Option<Self> {
        let reason = result.reason.clone()?;
        Some(Self { run: result.job.run.clone(), lease: result.job.lease, failed: result.failed, reason })
    }
}

/// Logs when sampling of a run starts, and when it ends.
fn log_sampling(sampled: &mut BTreeSet<String>, waiting: &BTreeMap<String, i64>) {
    let waiting_of = |run: &str| waiting.get(run).copied().unwrap_or(0);
    for (run, waiting) in waiting {
        if sampling::halvings(*waiting) > 0 && sampled.insert(run.clone()) {
            tracing::info!(
                run,
                waiting,
                "Too many episodes wait for their critique; only a sample is criticised."
            );
        }
    }
    sampled.retain(|run| {
        let is_sampled = waiting_of(run) > sampling::MAX_WAITING / 2;
        if !is_sampled {
            tracing::info!(run, "The critique has caught up; every episode is criticised again.");
        }
        is_sampled
    });
}
