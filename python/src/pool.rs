//! The threads a batch is stepped by.

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors::invalid;

/// Environments below which a batch is stepped by the calling thread: `env_core` does not share so few.
const WORTH_SHARING: usize = 64;
/// Most threads of one batch.
const MOST: usize = 1024;

/// Threads of a batch's own; none where it is stepped by whoever calls.
pub(crate) struct Pool(Option<ThreadPool>);

impl Pool {
    /// `threads` of them, or one for each core; what is forked after this is made is forked without its threads, so processes
    /// make their own environments.
    pub(crate) fn new(threads: Option<usize>, envs: usize) -> PyResult<Self> {
        if let Some(threads) = threads.filter(|threads| !(1..=MOST).contains(threads)) {
            return Err(invalid("threads", format!("{threads} is not from 1 to {MOST}")));
        }
        // Handing over and waiting costs tens of microseconds, in which one thread steps a hundred environments.
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        if envs < WORTH_SHARING || threads.unwrap_or(cores) == 1 {
            return Ok(Self(None));
        }
        let builder = ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0));
        let pool = builder.thread_name(|n| format!("sparring-{n}")).build();
        pool.map(|pool| Self(Some(pool))).map_err(|error| invalid("threads", error))
    }

    /// Does it there.
    pub(crate) fn run<R: Send>(&self, what: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(pool) => pool.install(what),
            None => what(),
        }
    }

    /// Whether whoever calls steps them.
    pub(crate) const fn alone(&self) -> bool {
        self.0.is_none()
    }

    /// How many there are.
    pub(crate) fn threads(&self) -> usize {
        self.0.as_ref().map_or(1, ThreadPool::current_num_threads)
    }
}
