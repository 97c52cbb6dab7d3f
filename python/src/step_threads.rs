//! The threads that step a batch.

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::{invalid, rejected};

/// Environments below which the calling thread steps a batch: `env_core` does not split smaller batches.
const MIN_SHARED_ENVS: usize = 64;
/// Maximum number of threads of one batch.
const MAX_THREADS: usize = 1024;

/// Thread pool of one batch, or none if the calling thread steps it.
pub(crate) struct StepThreads(Option<ThreadPool>);

impl StepThreads {
    /// Starts `threads` threads, by default one per core.
    ///
    /// A fork copies no threads, so every process has to make its own environments.
    ///
    /// # Errors
    /// `ValueError` if the number is not from 1 to [`MAX_THREADS`] or the threads cannot be started.
    pub(crate) fn new(threads: Option<usize>, envs: usize) -> PyResult<Self> {
        if let Some(threads) = threads.filter(|threads| !(1..=MAX_THREADS).contains(threads)) {
            return Err(invalid("threads", format!("from 1 to {MAX_THREADS}"), threads));
        }
        // Dispatching work to threads costs tens of microseconds, in which one thread steps a hundred environments.
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        if envs < MIN_SHARED_ENVS || threads.unwrap_or(cores) == 1 {
            return Ok(Self(None));
        }
        let builder = ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0));
        let pool = builder.thread_name(|n| format!("sparring-{n}")).build();
        pool.map(|pool| Self(Some(pool))).map_err(|error| rejected("threads", error))
    }

    /// Runs a task in the pool and waits for its result.
    pub(crate) fn run<R: Send>(&self, task: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(pool) => pool.install(task),
            None => task(),
        }
    }

    /// True if the calling thread steps the batch.
    pub(crate) const fn is_inline(&self) -> bool {
        self.0.is_none()
    }

    /// Number of threads that step the batch, at least 1.
    pub(crate) fn count(&self) -> usize {
        self.0.as_ref().map_or(1, ThreadPool::current_num_threads)
    }
}
