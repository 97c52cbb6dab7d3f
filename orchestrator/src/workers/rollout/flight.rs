//! One group: taken, flown, replayed, counted and pushed.

use crate::store::run_policies::RunPolicy;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::Duration;

use futures_util::future::join_all;
use rayon::prelude::*;
use tokio::sync::oneshot;

use super::RolloutWorkers;
use crate::metrics;
use crate::ids::{LeaseId, RunId};
use crate::engine::error::ServiceError;
use crate::leases::renew::RenewLease;
use crate::results::report::StoreResults;
use crate::rollouts::run_episode::{built_in, chat, RolloutOutcome, RecordingBudget};
use crate::rollouts::push::{PushGroup, ModelUsage};
use crate::rollouts::settings::ReportTrouble;
use crate::rollouts::rollout_lease::{ReturnRolloutLease, TTL_S};
use crate::rollouts::{RolloutError, RolloutGroup};

/// Tries at storing a group while the server is busy, and the pause between them.
const TRIES: u32 = 40;
const PAUSE: Duration = Duration::from_millis(250);

/// How a group ended.
pub(super) enum Ended {
    /// Something came of it, or there was nothing to fly.
    Well,
    /// Nothing came of it.
    Badly,
}

impl RolloutWorkers {
    /// Takes a group of a run, flies it and pushes it.
    pub(super) async fn fly(&self, run: RunId) -> Ended {
        let _busy = metrics::BusyGuard::new("rollout");
        let (lease, policy) = match self.desk.lease_for_rollout(&run).await {
            Ok(taken) => taken,
            // Others take what is prepared, or the run has just been paused.
            Err(ServiceError::NotReady | ServiceError::Paused(_) | ServiceError::Stopping) => {
                return Ended::Well;
            }
            Err(error) => {
                self.tell(&run, format!("no scenario could be leased: {error}")).await;
                return Ended::Badly;
            }
        };
        let flown = async {
            let ground = RolloutGroup::load(&self.desk, run.clone(), lease.clone(), policy).await?;
            self.flown(Arc::new(ground)).await
        };
        match flown.await {
            Ok(true) => Ended::Well,
            Ok(false) => Ended::Badly,
            Err(RolloutError::Training(ServiceError::Stopping)) => Ended::Well,
            Err(error) => {
                tracing::warn!(%run, %lease, %error, "A group could not be flown and is given back.");
                self.tell(&run, format!("a group could not be flown: {error}")).await;
                self.give_back(lease).await;
                Ended::Badly
            }
        }
    }

    /// Whether anything was flown to an end.
    async fn flown(&self, ground: Arc<RolloutGroup>) -> Result<bool, RolloutError> {
        let room = Arc::new(ground.room());
        let outcomes = tokio::select! {
            outcomes = self.all(&ground, &room) => outcomes?,
            never = self.renew(&ground) => match never {},
        };
        let trouble = outcomes.iter().find_map(|outcome| outcome.flight.as_ref().err().cloned());
        let lost = outcomes.iter().filter(|outcome| outcome.flight.is_err()).count();
        let flown = outcomes.len() - lost;
        let took = self.took(&outcomes);
        let report = self.desk.replay_results(&ground.run, ground.claims(&outcomes)?).await?;
        let (run, lease) = (ground.run.clone(), ground.lease.clone());
        let policy_version = ground.policy.version;
        let audited = report.episodes.clone();
        let packing = tokio::task::spawn_blocking(move || -> Result<_, RolloutError> {
            let told = ground.told(outcomes, &audited, &room)?;
            Ok(told.map(crate::rollouts::trajectory_group::TrajectoryGroup::pack).transpose()?)
        });
        let packed = packing.await.map_err(|error| RolloutError::Thread(error.to_string()))??;
        let mut tries = 0;
        loop {
            let report = StoreResults { run: run.clone(), policy_version: None, report: report.clone() };
            let push = PushGroup {
                lease: lease.clone(),
                policy_version,
                report,
                packed: packed.clone(),
                episodes: (flown, lost),
                trouble: trouble.clone(),
                took,
            };
            match self.desk.writer.change(push).await {
                Err(error) if error.is_temporary() && tries < TRIES => {
                    tries += 1;
                    tokio::time::sleep(PAUSE).await;
                }
                pushed => {
                    pushed?;
                    return Ok(flown > 0);
                }
            }
        }
    }

    /// Flies all episodes of a group.
    async fn all(&self, ground: &Arc<RolloutGroup>, room: &Arc<RecordingBudget>) -> Result<Vec<RolloutOutcome>, RolloutError> {
        if ground.policy.policy == RunPolicy::Chat {
            let Some(endpoint) = &self.endpoint else {
                return Err(RolloutError::Thread("there is no language model".to_owned()));
            };
            let one = |_| chat(ground.run.as_str(), &ground.scenario, endpoint, &ground.settings, room);
            return Ok(join_all((0..ground.size()).map(one)).await);
        }
        let (told, done) = oneshot::channel();
        let (ground, room) = (Arc::clone(ground), Arc::clone(room));
        self.pool.spawn(move || {
            let policy = ground.policy.policy.as_str();
            let one = |index| built_in(&ground.scenario, policy, ground.seed(index), &room);
            let all = || (0..ground.size()).into_par_iter().map(one).collect::<Vec<RolloutOutcome>>();
            // A policy that panics costs its group, and no other.
            if let Ok(outcomes) = std::panic::catch_unwind(AssertUnwindSafe(all)) {
                // Nobody listens any more where the service stops.
                drop(told.send(outcomes));
            }
        });
        done.await.map_err(|_| RolloutError::Thread("a policy panicked".to_owned()))
    }

    /// Holds the lease for as long as it is flown.
    async fn renew(&self, ground: &RolloutGroup) -> std::convert::Infallible {
        loop {
            tokio::time::sleep(Duration::from_secs(u64::from(TTL_S) / 3)).await;
            let renew = RenewLease { run: ground.run.clone(), lease: ground.lease.clone() };
            if let Err(error) = self.desk.writer.change(renew).await {
                tracing::warn!(lease = %ground.lease, %error, "The lease of a group could not be renewed.");
            }
        }
    }

    /// What a model took.
    fn took(&self, outcomes: &[RolloutOutcome]) -> ModelUsage {
        let Some(endpoint) = &self.endpoint else { return ModelUsage::default() };
        let metrics = || outcomes.iter().filter_map(|outcome| outcome.metrics);
        let (tokens_in, tokens_out) =
            (metrics().map(|m| m.tokens_in).sum(), metrics().map(|m| m.tokens_out).sum());
        ModelUsage { tokens_in, tokens_out, cost: endpoint.llm.config().cost(tokens_in, tokens_out) }
    }

    async fn tell(&self, run: &RunId, words: String) {
        if let Err(error) = self.desk.writer.change(ReportTrouble { run: run.to_string(), words }).await {
            tracing::debug!(%run, %error, "What went wrong could not be noted.");
        }
    }

    async fn give_back(&self, lease: LeaseId) {
        if let Err(error) = self.desk.writer.change(ReturnRolloutLease(lease)).await {
            tracing::warn!(%error, "The lease of a group could not be given back; it ends by itself.");
        }
    }
}
