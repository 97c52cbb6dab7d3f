//! [`LeaseAssigner`]: assigns the episodes of a lease to the slots of a batch and collects the finished ones.

use env_core::batch::episode_assigner::{
    self, AssignedEpisode, AssignedScenarios, BatchCall, EpisodeAssigner, PooledEpisode,
};
use env_core::batch::{Autoreset, BatchShape};
use parking_lot::MutexGuard;
use store::ids::EpisodeId;

use crate::results::reported::{ReportedEpisode, ReportedOutcome};
use crate::sessions::session_leases::SharedPool;
use crate::sessions::session_leases::pool::EpisodePool;

/// Free episodes of one task in a lease.
struct TaskPool<'a> {
    pool: MutexGuard<'a, EpisodePool>,
    task: &'static str,
}

impl episode_assigner::EpisodePool for TaskPool<'_> {
    /// Index of the episode in the lease.
    type EpisodeId = i64;

    fn take_episode(&mut self) -> Option<PooledEpisode<i64>> {
        let episode = self.pool.take_for_task(self.task)?;
        Some(PooledEpisode { id: episode.index, scenario: episode.scenario })
    }

    fn return_episode(&mut self, episode: PooledEpisode<i64>) {
        self.pool.give_back(episode.id);
    }
}

/// Assigner of a lease's episodes. Unfinished episodes return to the lease when it is dropped.
pub(crate) struct LeaseAssigner {
    pool: SharedPool,
    task: &'static str,
    assigner: EpisodeAssigner<i64>,
    /// Version of the policy that acts; `None` for the version of the lease.
    policy_version: Option<u32>,
}

impl LeaseAssigner {
    /// Creates the assigner of a batch whose scenarios come from `assigned`.
    pub(crate) fn new(
        pool: SharedPool,
        task: &'static str,
        assigned: AssignedScenarios,
        shape: BatchShape,
        autoreset: Autoreset,
    ) -> Self {
        Self { pool, task, assigner: EpisodeAssigner::new(assigned, shape, autoreset), policy_version: None }
    }

    /// Sets the version of the policy that acts.
    pub(crate) fn with_policy_version(mut self, policy_version: Option<u32>) -> Self {
        self.policy_version = policy_version;
        self
    }

    /// Assigns episodes to the slots that a step will start.
    pub(super) fn assign_for_step(&mut self) {
        let mut pool = TaskPool { pool: self.pool.lock(), task: self.task };
        // A slot without an episode rests.
        let _ = self.assigner.assign(&mut pool, BatchCall::Step);
    }

    /// Assigns episodes to the slots that a reset will start; a mask selects some of them.
    pub(super) fn assign_for_reset(&mut self, mask: Option<&[bool]>) {
        let mut pool = TaskPool { pool: self.pool.lock(), task: self.task };
        let _ = self.assigner.assign(&mut pool, BatchCall::Reset(mask));
    }

    /// Returns the unfinished episodes of slots that will be reset.
    pub(super) fn give_up(&mut self, mask: Option<&[bool]>) {
        let mut pool = TaskPool { pool: self.pool.lock(), task: self.task };
        self.assigner.return_running(&mut pool, mask);
    }

    /// Records a reset: its slots run the episodes that were assigned to them.
    pub(super) fn record_reset(&mut self, mask: Option<&[bool]>) {
        self.assigner.record_reset(mask);
    }

    /// Records the actions, team rewards and ended episodes of a step.
    pub(super) fn record_step(&mut self, actions: &[f32], team_rewards: &[f32], done: &[bool]) {
        self.assigner.record_step(None, actions, team_rewards, done);
    }

    /// Takes the episodes that have ended since the last call, as reports.
    pub(super) fn take_finished(&mut self) -> Vec<ReportedEpisode> {
        let finished = self.assigner.take_finished();
        if finished.is_empty() {
            return Vec::new();
        }
        let lease = self.pool.lock().lease.clone();
        let claim = |episode: AssignedEpisode<i64>| ReportedEpisode {
            episode: EpisodeId { lease: lease.clone(), index: episode.id }.to_string(),
            outcome: ReportedOutcome::Logged(episode.actions.to_log()),
            policy_version: self.policy_version,
            metrics: None,
        };
        finished.into_iter().map(claim).collect()
    }

    /// Returns the index in the lease of each slot's episode; −1 for a slot without one.
    pub(super) fn episode_indices(&self) -> impl Iterator<Item = i32> {
        self.assigner
            .running()
            .map(|episode| episode.and_then(|episode| i32::try_from(episode.id).ok()).unwrap_or(-1))
    }
}

impl Drop for LeaseAssigner {
    fn drop(&mut self) {
        let mut pool = TaskPool { pool: self.pool.lock(), task: self.task };
        self.assigner.return_all(&mut pool);
    }
}
