//! Rolls out one group: leases it, runs its episodes, replays them, and pushes the group to the feed.

use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::Duration;

use futures_util::future::join_all;
use policy_files::{PolicyFileError, PolicyReference};
use rayon::prelude::*;
use store::ids::{LeaseId, RunId};
use store::run_policies::RunPolicy;
use tokio::sync::oneshot;

use super::RolloutWorker;
use crate::engine::error::ServiceError;
use crate::leases::renew::RenewLease;
use crate::metrics;
use crate::ownership::Actor;
use crate::results::audit::CompletedAudit;
use crate::results::report::StoreResults;
use crate::rollouts::group_record::GroupRecord;
use crate::rollouts::push::{ModelUsage, PushGroup};
use crate::rollouts::rollout_lease::{ROLLOUT_TTL_S, ReturnRolloutLease};
use crate::rollouts::run_episode::{RolloutOutcome, roll_out_chat, roll_out_policy};
use crate::rollouts::settings::SetPolicyError;
use crate::rollouts::{RecordingBudget, RolloutError, RolloutGroup};

/// Maximum number of retries of storing a group while the server is busy or the database is locked: one minute.
const MAX_STORE_RETRIES: u32 = 240;
/// Pause between two tries of storing a group.
const STORE_RETRY_PAUSE: Duration = Duration::from_millis(250);

/// Success or failure of rolling out a group, which sets the backoff of its run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GroupRolloutStatus {
    /// At least one episode finished, or there was nothing to roll out.
    Succeeded,
    /// No episode of the group finished.
    Failed,
}

impl RolloutWorker {
    /// Leases a group of a run, rolls it out and pushes it.
    pub(super) async fn roll_out_group(&self, run: RunId) -> GroupRolloutStatus {
        let _busy = metrics::BusyGuard::new("rollout");
        let rollout_lease = match self.lease_service.lease_for_rollout(&run).await {
            Ok(rollout_lease) => rollout_lease,
            // Other clients lease the prepared scenarios, or the run was just paused.
            Err(ServiceError::NotReady | ServiceError::Paused(_) | ServiceError::Stopping) => {
                return GroupRolloutStatus::Succeeded;
            }
            Err(error) => {
                self.set_error(&run, format!("no scenario could be leased: {error}")).await;
                return GroupRolloutStatus::Failed;
            }
        };
        let lease = rollout_lease.lease.clone();
        let rollout = async {
            let group = RolloutGroup::load(&self.lease_service, run.clone(), rollout_lease).await?;
            self.roll_out_and_push(Arc::new(group)).await
        };
        match rollout.await {
            Ok(0) => GroupRolloutStatus::Failed,
            Ok(_) | Err(RolloutError::Service(ServiceError::Stopping)) => GroupRolloutStatus::Succeeded,
            Err(error) => {
                tracing::warn!(%run, %lease, %error, "A group could not be rolled out; its lease is returned.");
                self.set_error(&run, format!("a group could not be rolled out: {error}")).await;
                self.return_lease(lease).await;
                GroupRolloutStatus::Failed
            }
        }
    }

    /// Rolls out a group, replays it, and pushes it to the feed. Returns the number of episodes that finished.
    async fn roll_out_and_push(&self, group: Arc<RolloutGroup>) -> Result<usize, RolloutError> {
        let budget = Arc::new(group.recording_budget());
        let outcomes = tokio::select! {
            outcomes = self.roll_out_episodes(&group, &budget) => outcomes?,
            never = self.keep_renewing(&group) => match never {},
        };
        let error = outcomes.iter().find_map(|outcome| outcome.episode.as_ref().err().cloned());
        let lost = outcomes.iter().filter(|outcome| outcome.episode.is_err()).count();
        let finished = outcomes.len() - lost;
        let usage = self.usage(&outcomes);
        let audit = self.lease_service.replay_results(&group.run, group.to_reports(&outcomes)?).await?;
        let CompletedAudit { report, receipt } = audit;
        let (run, lease) = (group.run.clone(), group.lease.clone());
        let policy_version = group.policy.version;
        let audited = report.episodes.clone();
        let packing = tokio::task::spawn_blocking(move || -> Result<_, RolloutError> {
            let trajectory = group.to_trajectory(outcomes, &audited, &budget)?;
            Ok(trajectory.map(GroupRecord::pack).transpose()?)
        });
        let packed = packing.await.map_err(|error| RolloutError::Failed(error.to_string()))??;
        let mut retries = 0;
        loop {
            let push = PushGroup {
                lease: lease.clone(),
                policy_version,
                report: StoreResults { run: run.clone(), policy_version: None, report: report.clone() },
                packed: packed.clone(),
                finished,
                lost,
                error: error.clone(),
                usage,
            };
            match self.lease_service.writer.change(push).await {
                Err(error) if error.is_temporary() && retries < MAX_STORE_RETRIES => {
                    retries += 1;
                    tokio::time::sleep(STORE_RETRY_PAUSE).await;
                }
                pushed => {
                    pushed?;
                    receipt.acknowledge();
                    return Ok(finished);
                }
            }
        }
    }

    /// Rolls out all episodes of a group: chat episodes concurrently, those of other policies on the worker's threads.
    async fn roll_out_episodes(
        &self,
        group: &Arc<RolloutGroup>,
        budget: &Arc<RecordingBudget>,
    ) -> Result<Vec<RolloutOutcome>, RolloutError> {
        if group.policy.policy == RunPolicy::Chat {
            let Some(endpoint) = &self.endpoint else {
                return Err(RolloutError::Failed("there is no language model".to_owned()));
            };
            let episode =
                |_| roll_out_chat(group.run.as_str(), &group.scenario, endpoint, &group.settings, budget);
            return Ok(join_all((0..group.size()).map(episode)).await);
        }
        let (sender, receiver) = oneshot::channel();
        let (group, budget, folder) = (Arc::clone(group), Arc::clone(budget), self.policy_folder.clone());
        self.pool.spawn(move || {
            let episodes = || -> Result<Vec<RolloutOutcome>, PolicyFileError> {
                let policy = folder.open(&PolicyReference::parse(group.policy.policy.as_str()))?;
                let episode =
                    |index| roll_out_policy(&group.scenario, &*policy, group.policy_seed(index), &budget);
                Ok((0..group.size()).into_par_iter().map(episode).collect())
            };
            // A policy that panics loses its own group, and no other.
            if let Ok(outcomes) = std::panic::catch_unwind(AssertUnwindSafe(episodes)) {
                // The receiver is gone if the service stops.
                drop(sender.send(outcomes));
            }
        });
        let outcomes = receiver.await.map_err(|_| RolloutError::Failed("a policy panicked".to_owned()))?;
        outcomes.map_err(|error| RolloutError::Failed(error.to_string()))
    }

    /// Renews the lease of a group until the future is dropped.
    async fn keep_renewing(&self, group: &RolloutGroup) -> std::convert::Infallible {
        loop {
            tokio::time::sleep(Duration::from_secs(u64::from(ROLLOUT_TTL_S) / 3)).await;
            let (run, lease) = (group.run.clone(), group.lease.clone());
            let renew = RenewLease { run, lease, actor: Actor::Server };
            if let Err(error) = self.lease_service.writer.change(renew).await {
                tracing::warn!(lease = %group.lease, %error, "The lease of a group could not be renewed.");
            }
        }
    }

    /// Returns the tokens and the cost of episodes; zero for a built-in policy.
    fn usage(&self, outcomes: &[RolloutOutcome]) -> ModelUsage {
        let Some(endpoint) = &self.endpoint else { return ModelUsage::default() };
        let metrics = || outcomes.iter().filter_map(|outcome| outcome.metrics);
        let tokens_in = metrics().map(|metrics| metrics.tokens_in).sum();
        let tokens_out = metrics().map(|metrics| metrics.tokens_out).sum();
        ModelUsage { tokens_in, tokens_out, cost: endpoint.llm.config().cost(tokens_in, tokens_out) }
    }

    /// Stores why a run's policy failed.
    async fn set_error(&self, run: &RunId, error: String) {
        let change = SetPolicyError { run: run.to_string(), error };
        if let Err(error) = self.lease_service.writer.change(change).await {
            tracing::debug!(%run, %error, "The failure of a policy could not be stored.");
        }
    }

    async fn return_lease(&self, lease: LeaseId) {
        if let Err(error) = self.lease_service.writer.change(ReturnRolloutLease(lease)).await {
            tracing::warn!(%error, "The lease of a group could not be returned; it will expire.");
        }
    }
}
