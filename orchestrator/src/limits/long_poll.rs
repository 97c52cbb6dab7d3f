//! Long polls: requests that wait until a group is finished, limited in number.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::Instant;

use super::constants::MAX_LONG_POLLS;

/// Limit on requests that wait for finished groups.
#[derive(Debug, Clone)]
pub struct LongPollLimit {
    permits: Arc<Semaphore>,
    pushed: watch::Receiver<u64>,
    stopped: watch::Receiver<bool>,
}

/// Error of a long poll beyond the limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{limit} long polls are open; retry later")]
pub struct TooManyLongPolls {
    /// Maximum number of requests that wait.
    pub limit: usize,
}

impl LongPollLimit {
    /// Creates the limit. `pushed` signals that a group was pushed, `stopped` that the service stops.
    #[must_use]
    pub fn new(pushed: watch::Receiver<u64>, stopped: watch::Receiver<bool>) -> Self {
        Self { permits: Arc::new(Semaphore::new(MAX_LONG_POLLS)), pushed, stopped }
    }

    /// Takes a permit to wait.
    ///
    /// # Errors
    /// Returns [`TooManyLongPolls`] if no permit is free.
    pub fn acquire(&self) -> Result<OwnedSemaphorePermit, TooManyLongPolls> {
        let permit = Arc::clone(&self.permits).try_acquire_owned();
        permit.map_err(|_| TooManyLongPolls { limit: MAX_LONG_POLLS })
    }

    /// Returns a watch for pushes after this call.
    #[must_use]
    pub fn watch(&self) -> PushWatch {
        let mut watch = PushWatch { pushed: self.pushed.clone(), stopped: self.stopped.clone() };
        watch.mark_seen();
        watch
    }
}

/// Watch for groups that are pushed to the feed.
#[derive(Debug)]
pub struct PushWatch {
    pushed: watch::Receiver<u64>,
    stopped: watch::Receiver<bool>,
}

impl PushWatch {
    /// Marks all pushes until now as seen.
    pub fn mark_seen(&mut self) {
        self.pushed.mark_unchanged();
    }

    /// Waits for an unseen push, at most until `deadline`. Returns false if the service stops.
    pub async fn wait(&mut self, deadline: Instant) -> bool {
        tokio::select! {
            pushed = self.pushed.changed() => pushed.is_ok(),
            // A dropped sender also means that the service stops.
            _ = self.stopped.wait_for(|stopped| *stopped) => false,
            () = tokio::time::sleep_until(deadline) => true,
        }
    }
}
