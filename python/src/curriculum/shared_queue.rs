//! [`SharedQueue`]: the episode queue as environments and threads share it.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::episode_queue::EpisodeQueue;

/// The queue with its lock and a condition variable for changes of it.
#[derive(Debug, Default)]
pub(super) struct SharedQueue {
    queue: Mutex<EpisodeQueue>,
    changed: Condvar,
}

impl SharedQueue {
    /// Locks the queue for this thread.
    pub(super) fn lock(&self) -> MutexGuard<'_, EpisodeQueue> {
        // No holder can panic; even if one did, the queue would be valid.
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a change of the queue, at most for `timeout`.
    pub(super) fn wait<'a>(
        &self,
        queue: MutexGuard<'a, EpisodeQueue>,
        timeout: Duration,
    ) -> MutexGuard<'a, EpisodeQueue> {
        self.changed.wait_timeout(queue, timeout).unwrap_or_else(PoisonError::into_inner).0
    }

    /// Sleeps for `duration`, or until the curriculum is closed.
    pub(super) fn pause(&self, duration: Duration) {
        let until = Instant::now() + duration;
        let mut queue = self.lock();
        while !queue.is_closing && Instant::now() < until {
            queue = self.wait(queue, until.saturating_duration_since(Instant::now()));
        }
    }

    /// Wakes all threads that wait for a change.
    pub(super) fn notify(&self) {
        self.changed.notify_all();
    }
}
