//! Thread pools for computation, each with a scheduling priority.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use tokio::sync::oneshot;

/// Scheduling priority of a thread. Only Linux has priorities for single threads; on other systems all threads are equal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ThreadPriority {
    /// A client waits for the result, with its agent at a standstill.
    Normal,
    /// Bulk work: after threads that answer requests, lease scenarios or commit, but before background work.
    Bulk,
    /// Background work: no client waits for it.
    Background,
}

impl ThreadPriority {
    /// The nice value. Beside a thread of normal priority, 5 gives a third of its share of a core, and 19 a sixty-fifth.
    const fn nice(self) -> i32 {
        match self {
            Self::Normal => 0,
            Self::Bulk => 5,
            Self::Background => 19,
        }
    }

    /// Applies the priority to the current thread.
    pub fn apply(self) {
        #[cfg(target_os = "linux")]
        if self != Self::Normal
            && let Err(error) = rustix::process::nice(self.nice())
        {
            tracing::debug!(error = %error, "The priority of a thread could not be lowered.");
        }
    }
}

/// Creates a pool of `threads` threads with a name prefix, or of as many as there are cores if `threads` is 0.
///
/// # Errors
/// Returns an error if the system cannot create the threads.
pub fn pool(
    name: &'static str,
    threads: usize,
    priority: ThreadPriority,
) -> Result<Arc<ThreadPool>, ThreadPoolBuildError> {
    ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(move |i| format!("{name}-{i}"))
        .start_handler(move |_| priority.apply())
        .build()
        .map(Arc::new)
}

/// Runs a function on a pool, without blocking a thread of the runtime. `None` if the function panics, or if the process stops.
pub async fn run_on<T: Send + 'static>(
    pool: &ThreadPool,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let (sender, receiver) = oneshot::channel();
    pool.spawn(move || {
        // A panic drops the sender. Whatever the function has changed is dropped with it.
        if let Ok(result) = std::panic::catch_unwind(AssertUnwindSafe(work)) {
            drop(sender.send(result));
        }
    });
    receiver.await.ok()
}

/// Half of the number of cores, rounded up.
#[must_use]
pub fn half_of_cores() -> usize {
    std::thread::available_parallelism().map_or(1, |all| all.get().div_ceil(2))
}
