//! [`EpisodeReservation`]: an episode of a lease while a session runs it.

use std::sync::Arc;

use api_types::{Judge, ResultReceipt};
use env_core::{ActionLog, Scenario};
use store::ids::{EpisodeId, RunId};

use super::run_end::RunEnd;
use super::{SessionLeases, SharedPool};
use crate::engine::error::ServiceError;
use crate::leases::end::ReleaseLease;
use crate::ownership::Actor;
use crate::results::reported::{ReportedEpisode, ReportedOutcome};
use crate::sessions::session_request::EpisodeSource;

/// Episode of a lease that one session runs.
///
/// Dropping the reservation before its outcome is reported returns the episode to the pool; its first attempt is lost. If the
/// lease was taken for this session alone, it is released as well.
#[derive(Debug)]
pub(crate) struct EpisodeReservation {
    pub(super) leases: Arc<SessionLeases>,
    pub(super) pool: SharedPool,
    /// Id of the run.
    pub(crate) run: RunId,
    /// Id of the episode.
    pub(crate) episode: EpisodeId,
    /// Scenario of the episode.
    pub(crate) scenario: Scenario,
    /// Judge of the steps, if the run's settings name one.
    pub(crate) judge: Option<Judge>,
    /// Version of the policy that acts; `None` for the version of the lease.
    pub(super) policy_version: Option<u32>,
    /// True if the lease was taken for this session alone.
    pub(super) is_exclusive: bool,
    pub(super) is_reported: bool,
    pub(super) run_end: RunEnd,
}

impl EpisodeReservation {
    /// Sets the version of the policy that acts. Siblings of a group may have different versions.
    pub(super) fn with_policy_version(mut self, policy_version: Option<u32>) -> Self {
        self.policy_version = policy_version;
        self
    }

    /// Returns true if a source has the same lease, or a named group of the same run.
    pub(crate) fn overlaps(&self, source: &EpisodeSource) -> bool {
        match source {
            EpisodeSource::Lease { run, lease, .. } => *run == self.run && *lease == self.episode.lease,
            EpisodeSource::Run { run, group: Some(_), .. } => *run == self.run,
            EpisodeSource::Run { .. } | EpisodeSource::Scenario(_) => false,
        }
    }

    /// Checks that the run was not deleted.
    ///
    /// # Errors
    /// Returns [`ServiceError::UnknownRun`] if it was.
    pub(crate) fn check_run(&self) -> Result<(), ServiceError> {
        if self.run_end.is_deleted() { Err(ServiceError::UnknownRun(self.run.to_string())) } else { Ok(()) }
    }

    /// Renews the lease if a third of its time is over.
    pub(crate) async fn renew_lease(&self) {
        self.leases.renew(&self.pool).await;
    }

    /// Reports the finished episode; retries for a while if the server is busy.
    ///
    /// # Errors
    /// Returns the error of the report if the retries did not help.
    pub(crate) async fn report(&mut self, log: &ActionLog) -> Result<ResultReceipt, ServiceError> {
        let claim = ReportedEpisode {
            episode: self.episode.to_string(),
            outcome: ReportedOutcome::Logged(log.clone()),
            policy_version: self.policy_version,
            metrics: None,
        };
        let receipts = self.leases.report(&self.pool, &[claim]).await?;
        self.is_reported = true;
        receipts.into_iter().next().ok_or_else(|| ServiceError::invalid("episode", "it has no receipt"))
    }
}

impl Drop for EpisodeReservation {
    fn drop(&mut self) {
        if self.is_reported || self.run_end.is_deleted() {
            return;
        }
        self.pool.lock().give_back(self.episode.index);
        if !self.is_exclusive {
            // Another session may run the episode, or the lease expires.
            return self.leases.spawn_store_abandoned(&self.pool);
        }
        let (run, lease) = (self.run.clone(), self.episode.lease.clone());
        let release = ReleaseLease { run, lease, actor: Actor::Server };
        let (writer, episode) = (self.leases.lease_service().writer.clone(), self.episode.clone());
        self.leases.spawn_tracked(async move {
            if let Err(error) = writer.change(release).await {
                tracing::warn!(%episode, %error, "The lease of a session could not be released; it will expire.");
            }
        });
    }
}
