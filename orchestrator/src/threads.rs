//! Pools of threads that compute, each at the priority that its work has against that of others.

use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};

/// How far a thread stands back. Where the system has priorities for threads (Linux); elsewhere all are alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Priority {
    /// Somebody waits for it with an agent at a standstill.
    Usual,
    /// It comes in bulk: behind whoever answers, leases scenarios or commits, but far before what nobody waits for.
    Bulk,
    /// Nobody waits for it.
    Background,
}

impl Priority {
    /// The nice value: 5 makes a thread's share of a core a third of another's, 19 makes it a sixty-fifth.
    const fn nice(self) -> i32 {
        match self {
            Self::Usual => 0,
            Self::Bulk => 5,
            Self::Background => 19,
        }
    }

    /// Gives this thread its priority.
    pub fn take(self) {
        #[cfg(target_os = "linux")]
        if self != Self::Usual
            && let Err(error) = rustix::process::nice(self.nice())
        {
            tracing::debug!(error = %error, "A thread that should stand back runs at the usual priority.");
        }
    }
}

/// Threads of this name; as many as there are cores if 0.
///
/// # Errors
/// A system that gives no threads.
pub fn pool(
    name: &'static str,
    threads: usize,
    priority: Priority,
) -> Result<ThreadPool, ThreadPoolBuildError> {
    ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(move |i| format!("{name}-{i}"))
        .start_handler(move |_| priority.take())
        .build()
}

/// Half as many threads as there are cores, or one.
#[must_use]
pub fn half() -> usize {
    std::thread::available_parallelism().map_or(1, |all| all.get().div_ceil(2))
}
