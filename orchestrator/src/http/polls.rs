//! Trainers that wait for groups: so many at a time, woken when some were pushed.

use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::Instant;

use super::problem::Problem;

/// Requests that may wait at once.
const MOST: usize = 64;

/// Who waits for groups.
#[derive(Debug, Clone)]
pub struct Polls {
    places: Arc<Semaphore>,
    pushed: watch::Receiver<u64>,
    stopped: watch::Receiver<bool>,
}

impl Polls {
    /// Waiting for pushes until the service stops.
    #[must_use]
    pub fn new(pushed: watch::Receiver<u64>, stopped: watch::Receiver<bool>) -> Self {
        Self { places: Arc::new(Semaphore::new(MOST)), pushed, stopped }
    }

    /// A place to wait.
    ///
    /// # Errors
    /// None is free.
    pub(super) fn enter(&self) -> Result<OwnedSemaphorePermit, Problem> {
        Arc::clone(&self.places).try_acquire_owned().map_err(|_| Problem::too_many_polls(MOST))
    }

    /// A watch that knows of all pushes until now.
    pub(super) fn watch(&self) -> Watch {
        let mut watch = Watch { pushed: self.pushed.clone(), stopped: self.stopped.clone() };
        watch.pushed.mark_unchanged();
        watch
    }
}

/// Notices pushes.
pub(super) struct Watch {
    pushed: watch::Receiver<u64>,
    stopped: watch::Receiver<bool>,
}

impl Watch {
    /// Knows of all pushes until now.
    pub(super) fn seen(&mut self) {
        self.pushed.mark_unchanged();
    }

    /// Waits for a push that it did not know of, at most until then; whether there is any use in looking again.
    pub(super) async fn next(&mut self, until: Instant) -> bool {
        tokio::select! {
            pushed = self.pushed.changed() => pushed.is_ok(),
            // Its going away means the same.
            _ = self.stopped.wait_for(|stopped| *stopped) => false,
            () = tokio::time::sleep_until(until) => true,
        }
    }
}
