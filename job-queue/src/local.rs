//! Queue in this process: jobs run on thread pools, one for each kind.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use jobs::prepare::unsolvable::UnsolvableParams;
use jobs::{JobContext, JobOutput, JobPayload};
use rayon::ThreadPool;
use tokio::sync::oneshot;

use crate::queue::{CompletedJob, JobError, JobQueue, Receipt};
use crate::status::QueueStatus;

/// Thread pools of a process, by kind of job.
#[derive(Debug, Clone)]
pub struct QueuePools {
    /// Threads that prepare: scenarios that are hard to find must not delay the replay of results.
    pub prepare: Arc<ThreadPool>,
    /// Threads that replay results.
    pub audit: Arc<ThreadPool>,
    /// Threads that criticise, at background priority.
    pub critique: Arc<ThreadPool>,
}

impl QueuePools {
    fn of(&self, job: &JobPayload) -> &Arc<ThreadPool> {
        match job {
            JobPayload::Prepare(_) => &self.prepare,
            JobPayload::Audit(_) => &self.audit,
            JobPayload::Critique(_) => &self.critique,
        }
    }
}

/// Queue that does every job on threads of this process.
#[derive(Debug, Clone)]
pub struct LocalQueue {
    pools: QueuePools,
    unsolvable: Arc<UnsolvableParams>,
}

/// Result of a job, with the time of its computation.
#[derive(Debug)]
pub(crate) struct TimedOutput {
    pub(crate) output: JobOutput,
    pub(crate) duration: Duration,
}

impl LocalQueue {
    /// Creates a queue on thread pools.
    #[must_use]
    pub fn new(pools: QueuePools) -> Self {
        Self { pools, unsolvable: Arc::default() }
    }

    /// Number of threads for jobs of the same kind.
    pub(crate) fn threads(&self, job: &JobPayload) -> usize {
        self.pools.of(job).current_num_threads()
    }

    /// Computes something at background priority.
    ///
    /// # Errors
    /// Returns [`JobError`] if the computation panics, or if the process stops.
    pub(crate) async fn run_in_background<T: Send + 'static>(
        &self,
        compute: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, JobError> {
        let (sender, receiver) = oneshot::channel();
        self.pools.critique.spawn(move || {
            let computed = std::panic::catch_unwind(AssertUnwindSafe(compute));
            // The receiver is gone if the caller does not want the result any more.
            drop(sender.send(computed.map_err(|_| JobError::Panicked)));
        });
        receiver.await.unwrap_or(Err(JobError::Cancelled))
    }

    /// Does a job, and measures how long the computation takes.
    pub(crate) async fn run_timed(&self, job: Arc<JobPayload>) -> Result<TimedOutput, JobError> {
        let (sender, receiver) = oneshot::channel();
        let unsolvable = Arc::clone(&self.unsolvable);
        let pool = Arc::clone(self.pools.of(&job));
        pool.spawn(move || {
            let started = Instant::now();
            // The receiver is gone if the caller does not want the result any more; then a search ends.
            let is_wanted = || !sender.is_closed();
            let context = JobContext { unsolvable: &unsolvable, is_wanted: &is_wanted };
            // The job has no state outside its payload, so that a panic leaves nothing half done.
            let output = std::panic::catch_unwind(AssertUnwindSafe(|| job.run(context)));
            let output = output.map(|output| TimedOutput { output, duration: started.elapsed() });
            let _ = sender.send(output.map_err(|_| JobError::Panicked));
        });
        receiver.await.unwrap_or(Err(JobError::Cancelled))
    }
}

impl JobQueue for LocalQueue {
    fn run(&self, job: JobPayload) -> BoxFuture<'static, Result<CompletedJob, JobError>> {
        let queue = self.clone();
        async move {
            let TimedOutput { output, .. } = queue.run_timed(Arc::new(job)).await?;
            Ok(CompletedJob { output, receipt: Receipt::default() })
        }
        .boxed()
    }

    fn status(&self) -> QueueStatus {
        QueueStatus::default()
    }
}
