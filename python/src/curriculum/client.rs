//! `CurriculumClient`: the interface through which a batch of environments gets episodes and returns results.

use std::sync::MutexGuard;
use std::time::{Duration, Instant};

use env_core::Scenario;
use env_core::batch::episode_assigner::{BatchCall, EpisodeAssigner};
use pyo3::prelude::*;

use super::episode_queue::{EPISODES_PER_ENV, EpisodeQueue};
use super::error::WaitError;
use super::fetch::LeaseRequest;
use super::http_client::HttpClient;
use super::lease::LeasedEpisode;
use super::shared_queue::SharedQueue;

/// Interval at which a waiting trainer lets Python handle signals.
const SIGNAL_CHECK_INTERVAL: Duration = Duration::from_millis(200);

/// A run's curriculum, shared by its environments and its two threads.
pub(crate) struct CurriculumClient {
    pub(super) shared: SharedQueue,
    pub(super) http: HttpClient,
    pub(super) lease_request: LeaseRequest,
    /// Longest time that a step waits.
    pub(super) max_wait: Duration,
    /// Maximum number of unsent episodes.
    pub(super) max_unsent: usize,
}

impl CurriculumClient {
    /// Registers `envs` environments; waits for the first lease and returns its first scenario.
    ///
    /// # Errors
    /// [`WaitError`] if no lease arrives in time, the evaluation is complete, or the curriculum is closed or failed.
    pub(crate) fn register_envs(&self, envs: usize) -> Result<Scenario, WaitError> {
        let until = Instant::now() + self.max_wait;
        let mut queue = self.shared.lock();
        queue.target += EPISODES_PER_ENV * envs;
        queue.envs += envs;
        self.shared.notify();
        loop {
            if let Some(first) = queue.first_scenario() {
                return Ok(first);
            }
            queue.check_usable()?;
            if queue.is_exhausted {
                return Err("no episode is left: the evaluation is complete".to_owned().into());
            }
            queue = self.wait_until(queue, until, &|_| "the server granted no lease".to_owned())?;
        }
    }

    /// Assigns an episode to every environment that is about to begin one.
    ///
    /// Waits if no episode is ready or too many results are unsent.
    ///
    /// # Errors
    /// [`WaitError`] if the wait is too long or interrupted, or the curriculum is closed or failed.
    pub(crate) fn assign(
        &self,
        assigner: &mut EpisodeAssigner<LeasedEpisode>,
        call: BatchCall<'_>,
    ) -> Result<(), WaitError> {
        let until = Instant::now() + self.max_wait;
        let mut queue = self.shared.lock();
        loop {
            // A failure is raised before another episode begins.
            queue.check_usable()?;
            assigner.version = queue.policy_version;
            if queue.unsent >= self.max_unsent && assigner.needs_assignment(call) {
                let full = |queue: &EpisodeQueue| {
                    format!("{} episodes wait to be submitted, the limit set by `buffer`", queue.unsent)
                };
                queue = self.wait_until(queue, until, &full)?;
                continue;
            }
            let unassigned = assigner.assign(&mut *queue, call);
            if queue.ready() < queue.target {
                self.shared.notify();
            }
            if unassigned == 0 {
                return Ok(());
            }
            if queue.is_exhausted {
                if let BatchCall::Reset(mask) = call {
                    assigner.repeat_unassigned(mask);
                }
                return Ok(());
            }
            let message = |_: &EpisodeQueue| format!("no episode for {unassigned} environment(s)");
            queue = self.wait_until(queue, until, &message)?;
        }
    }

    /// Returns the unfinished episodes of all environments, or of those in the mask, to the queue.
    pub(crate) fn return_running(
        &self,
        assigner: &mut EpisodeAssigner<LeasedEpisode>,
        mask: Option<&[bool]>,
    ) {
        assigner.return_running(&mut *self.shared.lock(), mask);
    }

    /// Abandons the current episodes, which are not offered again.
    pub(crate) fn abandon(&self, assigner: &mut EpisodeAssigner<LeasedEpisode>) {
        let mut queue = self.shared.lock();
        assigner.abandon().iter().for_each(|episode| queue.abandon(episode));
        drop(queue);
        self.shared.notify();
    }

    /// Queues the results of the episodes that ended.
    pub(crate) fn finish(&self, assigner: &mut EpisodeAssigner<LeasedEpisode>) {
        let finished = assigner.take_finished();
        if finished.is_empty() {
            return;
        }
        let mut queue = self.shared.lock();
        finished.into_iter().for_each(|episode| queue.finish(episode));
        drop(queue);
        self.shared.notify();
    }

    /// Unregisters `envs` environments and returns all their episodes to the queue.
    pub(crate) fn unregister_envs(&self, assigner: &mut EpisodeAssigner<LeasedEpisode>, envs: usize) {
        let mut queue = self.shared.lock();
        assigner.return_all(&mut *queue);
        queue.target = queue.target.saturating_sub(EPISODES_PER_ENV * envs).max(1);
        queue.envs = queue.envs.saturating_sub(envs);
    }

    /// Waits for a change of the queue, or for the signal check interval, and handles Python signals.
    ///
    /// # Errors
    /// The exception of a Python signal handler.
    pub(super) fn wait_for_change<'a>(
        &'a self,
        queue: MutexGuard<'a, EpisodeQueue>,
    ) -> PyResult<MutexGuard<'a, EpisodeQueue>> {
        drop(self.shared.wait(queue, SIGNAL_CHECK_INTERVAL));
        // The queue is unlocked here: a thread that holds the interpreter lock may wait for it.
        Python::attach(|py| py.check_signals())?;
        Ok(self.shared.lock())
    }

    /// Waits for a change of the queue, unless the deadline is over or the server of this process has ended.
    fn wait_until<'a>(
        &'a self,
        queue: MutexGuard<'a, EpisodeQueue>,
        until: Instant,
        message: &dyn Fn(&EpisodeQueue) -> String,
    ) -> Result<MutexGuard<'a, EpisodeQueue>, WaitError> {
        queue.check_usable()?;
        if Instant::now() >= until || queue.server_exit.is_some() {
            return Err(format!("{}; {}", message(&queue), queue.stall_reason()).into());
        }
        self.wait_for_change(queue).map_err(WaitError::Interrupted)
    }
}
