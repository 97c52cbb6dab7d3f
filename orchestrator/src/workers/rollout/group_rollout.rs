//! Rolls out one group: leases it, runs its episodes, replays them, and pushes the group to the feed.

use std::sync::Arc;
use std::time::Duration;

use api_types::TrajectoryMetrics;
use job_queue::Receipt;
use job_queue::nats::server::{RemoteRollout, RemoteRolloutError, RolloutQueue};
use rollout::{RolledOutGroup, RolloutJob, RolloutPolicy};
use store::ids::{LeaseId, RunId};
use store::run_policies;

use super::RolloutWorker;
use super::placement::RolloutPlace;
use crate::engine::error::ServiceError;
use crate::leases::renew::RenewLease;
use crate::metrics;
use crate::ownership::Actor;
use crate::results::audit::CompletedAudit;
use crate::results::report::StoreResults;
use crate::rollouts::group_record::GroupRecord;
use crate::rollouts::push::{ModelUsage, PushGroup};
use crate::rollouts::rollout_lease::{ROLLOUT_TTL_S, ReturnRolloutLease, WithdrawRolloutLease};
use crate::rollouts::settings::SetPolicyError;
use crate::rollouts::{RolloutError, RolloutGroup};

/// Maximum number of retries of storing a group while the server is busy or the database is locked: one minute.
const MAX_STORE_RETRIES: u32 = 240;
/// Pause between two tries of storing a group.
const STORE_RETRY_PAUSE: Duration = Duration::from_millis(250);
/// Maximum number of workers that try to roll out a group that the server cannot roll out itself.
const MAX_REMOTE_ATTEMPTS: usize = 3;
/// Pause between two of these workers.
const REMOTE_RETRY_PAUSE: Duration = Duration::from_secs(1);

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
    pub(super) async fn roll_out_group(&self, run: RunId, place: RolloutPlace) -> GroupRolloutStatus {
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
            self.roll_out_and_push(Arc::new(group), place).await
        };
        match rollout.await {
            Ok(0) => GroupRolloutStatus::Failed,
            Ok(_) | Err(RolloutError::Service(ServiceError::Stopping)) => GroupRolloutStatus::Succeeded,
            Err(RolloutError::Superseded) => {
                tracing::debug!(%run, %lease, "The policy changed; the scenario is offered again.");
                self.withdraw_lease(lease).await;
                GroupRolloutStatus::Succeeded
            }
            Err(error @ RolloutError::NoWorker(_)) => {
                tracing::warn!(%run, %lease, %error, "A group was not rolled out; its scenario is offered again.");
                self.set_error(&run, error.to_string()).await;
                self.withdraw_lease(lease).await;
                GroupRolloutStatus::Failed
            }
            Err(error) => {
                tracing::warn!(%run, %lease, %error, "A group could not be rolled out; its lease is returned.");
                self.set_error(&run, format!("a group could not be rolled out: {error}")).await;
                self.return_lease(lease).await;
                GroupRolloutStatus::Failed
            }
        }
    }

    /// Rolls out a group, replays it, and pushes it to the feed. Returns the number of episodes that finished.
    async fn roll_out_and_push(
        &self,
        group: Arc<RolloutGroup>,
        place: RolloutPlace,
    ) -> Result<usize, RolloutError> {
        let RemoteRollout { group: rolled_out, receipt: rollout_receipt } = tokio::select! {
            rolled_out = self.roll_out_episodes(&group, place) => rolled_out?,
            never = self.keep_renewing(&group) => match never {},
        };
        let outcomes = &rolled_out.outcomes;
        let error = outcomes.iter().find_map(|outcome| outcome.episode.as_ref().err().cloned());
        let lost = outcomes.iter().filter(|outcome| outcome.episode.is_err()).count();
        let finished = outcomes.len() - lost;
        let usage = usage(&rolled_out);
        let audit = self.lease_service.replay_results(&group.run, group.to_reports(outcomes)?).await?;
        let CompletedAudit { report, mut receipt } = audit;
        receipt.merge(rollout_receipt);
        let (run, lease) = (group.run.clone(), group.lease.clone());
        let policy_version = group.policy.version;
        let audited = report.episodes.clone();
        let packing = tokio::task::spawn_blocking(move || -> Result<_, RolloutError> {
            let trajectory = group.to_trajectory(rolled_out, &audited)?;
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

    /// Rolls out all episodes of a group at a place. The server does what no worker did, if it has the policy.
    async fn roll_out_episodes(
        &self,
        group: &Arc<RolloutGroup>,
        place: RolloutPlace,
    ) -> Result<RemoteRollout, RolloutError> {
        let (loaded, folder) = (Arc::clone(group), self.policies.folder.clone());
        // The file is read, which takes too long for a thread of the runtime.
        let job = tokio::task::spawn_blocking(move || loaded.to_job(&folder)).await;
        let job = Arc::new(job.map_err(|error| RolloutError::Failed(error.to_string()))??);
        if place == RolloutPlace::Worker
            && let Some(remote) = &self.remote
            && let Some(rolled_out) = self.roll_out_remotely(remote, group, &job).await?
        {
            return Ok(rolled_out);
        }
        let is_chat = matches!(job.policy, RolloutPolicy::Chat(_));
        // A closed semaphore has no permits; this one is never closed.
        let _permit = if is_chat { None } else { self.permits.acquire().await.ok() };
        let rolled_out = self.policies.roll_out(&job, &self.pool).await;
        let group = rolled_out.map_err(|error| RolloutError::Failed(error.to_string()))?;
        Ok(RemoteRollout { group, receipt: Receipt::default() })
    }

    /// Lets workers roll out a group. `None` if the server has to roll it out itself.
    async fn roll_out_remotely(
        &self,
        remote: &RolloutQueue,
        group: &RolloutGroup,
        job: &RolloutJob,
    ) -> Result<Option<RemoteRollout>, RolloutError> {
        let is_possible_here =
            self.policies.endpoint.is_some() || !matches!(job.policy, RolloutPolicy::Chat(_));
        let mut attempt = 1;
        loop {
            let error = match remote.roll_out(job).await {
                Ok(rolled_out) => return Ok(Some(rolled_out)),
                Err(error) => error,
            };
            if matches!(error, RemoteRolloutError::Superseded) && self.is_superseded(group).await? {
                return Err(RolloutError::Superseded);
            }
            tracing::debug!(lease = %group.lease, %error, "No worker rolled out a group.");
            if is_possible_here {
                return Ok(None);
            }
            if attempt >= MAX_REMOTE_ATTEMPTS {
                return Err(RolloutError::NoWorker(error.to_string()));
            }
            attempt += 1;
            tokio::time::sleep(REMOTE_RETRY_PAUSE).await;
        }
    }

    /// Returns true if the policy of a group has a newer version: the database decides.
    async fn is_superseded(&self, group: &RolloutGroup) -> Result<bool, ServiceError> {
        let mut conn = self.readers.acquire().await?;
        let row = run_policies::get(&mut conn, group.run.as_str()).await?;
        Ok(row.is_none_or(|row| row.version > group.policy.version))
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

    async fn withdraw_lease(&self, lease: LeaseId) {
        if let Err(error) = self.lease_service.writer.change(WithdrawRolloutLease(lease)).await {
            tracing::warn!(%error, "The lease of a group could not be returned; it will expire.");
        }
    }
}

/// Returns the tokens and the cost of a group; zero for a policy without a language model.
fn usage(group: &RolledOutGroup) -> ModelUsage {
    let metrics = || group.outcomes.iter().filter_map(|outcome| outcome.metrics);
    let sum = |tokens: fn(&TrajectoryMetrics) -> u64| {
        metrics().fold(0_u64, |sum, metrics| sum.saturating_add(tokens(&metrics)))
    };
    ModelUsage {
        tokens_in: sum(|metrics| metrics.tokens_in),
        tokens_out: sum(|metrics| metrics.tokens_out),
        cost: group.cost,
    }
}
