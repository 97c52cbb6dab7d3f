//! Concurrency limits of expensive requests: planning, rollouts of posted actions, and searches.
//!
//! The work runs on blocking threads, so that other requests are answered meanwhile. It stops when its request is gone.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::constants::CONCURRENCY_WAIT_TIMEOUT;

/// Limit on concurrent work of one kind. It is one less than the number of cores, since the work keeps a core busy.
#[derive(Debug, Clone)]
pub struct ConcurrencyLimit {
    /// Clause that names the work in an error: "Too many {work}".
    work: &'static str,
    permits: Arc<Semaphore>,
    wait_timeout: Duration,
}

/// Concurrency limits of all kinds of work. They are separate, so that quick work does not wait for slow work.
#[derive(Debug, Clone)]
pub struct ConcurrencyLimits {
    /// Limit on plans for posted scenarios.
    pub planning: ConcurrencyLimit,
    /// Limit on rollouts of posted actions.
    pub rollouts: ConcurrencyLimit,
    /// Limit on searches through all episodes of a run.
    pub searches: ConcurrencyLimit,
}

/// Reason why expensive work was not done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ConcurrencyError {
    /// No permit became free in time.
    #[error("too many {0}; retry in a few seconds")]
    Overloaded(&'static str),
    /// The work panicked on its thread.
    #[error("the work panicked")]
    Panicked,
}

impl Default for ConcurrencyLimits {
    fn default() -> Self {
        Self {
            planning: ConcurrencyLimit::new("scenarios are being checked"),
            rollouts: ConcurrencyLimit::new("rollouts are running"),
            searches: ConcurrencyLimit::new("searches are running"),
        }
    }
}

/// Marks work as no longer wanted when it is dropped: the request was answered or cancelled, or its client disconnected.
struct WantedGuard(Arc<AtomicBool>);

impl Drop for WantedGuard {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

impl ConcurrencyLimit {
    fn new(work: &'static str) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let permits = Arc::new(Semaphore::new(cores.saturating_sub(1).max(1)));
        Self { work, permits, wait_timeout: CONCURRENCY_WAIT_TIMEOUT }
    }

    /// Runs `work` on a blocking thread as soon as a permit is free, and returns its result.
    ///
    /// `work` receives a function that returns false once the result is no longer wanted. The permit is held until the work
    /// has ended, even if the request is gone.
    ///
    /// # Errors
    /// Returns [`ConcurrencyError::Overloaded`] if no permit becomes free in time, and [`ConcurrencyError::Panicked`] if the
    /// work panics.
    pub async fn run<T: Send + 'static>(
        &self,
        work: impl FnOnce(&dyn Fn() -> bool) -> T + Send + 'static,
    ) -> Result<T, ConcurrencyError> {
        let permit = self.acquire().await?;
        let wanted = Arc::new(AtomicBool::new(true));
        let guard = WantedGuard(Arc::clone(&wanted));
        let result = tokio::task::spawn_blocking(move || {
            let _permit = permit;
            work(&|| wanted.load(Ordering::Relaxed))
        })
        .await;
        drop(guard);
        result.map_err(|_| ConcurrencyError::Panicked)
    }

    /// Waits for a permit, which is returned when it is dropped.
    ///
    /// # Errors
    /// Returns [`ConcurrencyError::Overloaded`] if no permit becomes free in time.
    pub async fn acquire(&self) -> Result<OwnedSemaphorePermit, ConcurrencyError> {
        let permit = tokio::time::timeout(self.wait_timeout, Arc::clone(&self.permits).acquire_owned()).await;
        permit.ok().and_then(Result::ok).ok_or(ConcurrencyError::Overloaded(self.work))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn single_permit() -> ConcurrencyLimit {
        ConcurrencyLimit {
            work: "tests are under way",
            permits: Arc::new(Semaphore::new(1)),
            wait_timeout: Duration::from_millis(50),
        }
    }

    /// Works until the result is no longer wanted.
    fn spin(wanted: &dyn Fn() -> bool) {
        while wanted() {
            std::thread::yield_now();
        }
    }

    #[tokio::test]
    async fn request_without_a_permit_is_rejected_in_time() {
        let limit = single_permit();
        let first = tokio::spawn({
            let limit = limit.clone();
            async move { limit.run(spin).await }
        });
        while limit.permits.available_permits() > 0 {
            tokio::task::yield_now().await;
        }
        assert_eq!(limit.run(|_| ()).await, Err(ConcurrencyError::Overloaded("tests are under way")));
        first.abort();
    }

    /// A cancelled request is dropped. Its work then ends and returns the permit.
    #[tokio::test]
    async fn work_ends_when_its_request_is_cancelled() {
        let limit = single_permit();
        let cancelled = tokio::time::timeout(Duration::from_millis(20), limit.run(spin)).await;
        assert!(cancelled.is_err());
        let limit = ConcurrencyLimit { wait_timeout: CONCURRENCY_WAIT_TIMEOUT, ..limit };
        assert!(limit.run(|wanted| wanted()).await.unwrap());
    }
}
