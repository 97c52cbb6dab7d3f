//! The service that grants leases and takes results, for trainers (over `/v1`), sessions and rollout workers alike.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;
use store::ids::RunId;
use store::leases::Purpose;
use store::{from_json, runs};
use tokio::sync::watch;

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::evaluations::lease::create_suite_lease;
use crate::leases::columns::create_column_lease;
use crate::leases::create::{CreateLease, GrantedLease};
use crate::leases::eval::create_eval_lease;
use crate::leases::session_episodes::SessionEpisodes;
use crate::ownership::Actor;
use crate::results::audit::{AuditEngine, CompletedAudit, audit};
use crate::results::audit_outcome::{AuditedEpisode, AuditedReport};
use crate::results::report::{ReportReceipts, StoreResults};
use crate::results::report_order::ReportOrder;
use crate::results::reported::ReportedEpisode;
use crate::rollouts::rollout_lease::{LeaseRolloutGroup, RolloutLease};
use crate::runs::settings::RunSettings;
use crate::runs::version_step::check_version_step;

/// How long a lease request waits for scenarios to be prepared before it is refused with `NotReady`.
const PREPARE_TIMEOUT: Duration = Duration::from_secs(10);

/// Results written by one change; lease requests are served between two parts.
const RESULTS_PER_CHANGE: usize = 25;

/// Grants leases and takes results.
#[derive(Debug, Clone)]
pub struct LeaseService {
    /// Handle to the one writer.
    pub writer: Writer,
    /// Pool of connections that read.
    pub readers: SqlitePool,
    /// Changes whenever scenarios were prepared.
    pub ready: watch::Receiver<u64>,
    /// Queues of waiting lease requests, by run.
    pub gates: Arc<LeaseGates>,
    /// Episodes that sessions run now.
    pub(crate) session_episodes: Arc<SessionEpisodes>,
    /// Replays results. Its threads also prepare leases for evaluation.
    pub audits: AuditEngine,
    /// Order in which the reports of a run are stored.
    pub report_order: ReportOrder,
}

/// One gate per run. Waiting requests pass it in order, so that a large lease is not overtaken for ever.
#[derive(Debug, Default)]
pub struct LeaseGates(parking_lot::Mutex<HashMap<RunId, Arc<tokio::sync::Mutex<()>>>>);

impl LeaseGates {
    fn of(&self, run: &RunId) -> Arc<tokio::sync::Mutex<()>> {
        let mut gates = self.0.lock();
        gates.retain(|_, gate| Arc::strong_count(gate) > 1); // no request waits there
        Arc::clone(gates.entry(run.clone()).or_default())
    }
}

impl LeaseService {
    /// Grants a lease. It waits up to 10 s for scenarios that are still being prepared.
    ///
    /// # Errors
    /// Returns [`ServiceError::NotReady`] if the preparation takes longer, and other errors if the lease may not be granted.
    pub async fn lease(&self, request: CreateLease) -> Result<GrantedLease, ServiceError> {
        if let Some(evaluation) = request.evaluation.filter(|_| request.purpose == Purpose::Eval) {
            return create_suite_lease(&self.writer, &self.audits.threads, request, evaluation).await;
        }
        if request.purpose == Purpose::Eval {
            return create_eval_lease(&self.writer, &self.audits.threads, request).await;
        }
        let run = request.run.clone();
        self.when_ready(&run, || self.writer.change(request.clone())).await
    }

    /// Grants a lease of columns.
    ///
    /// # Errors
    /// Returns an error if the lease may not be granted.
    pub async fn lease_columns(&self, request: CreateLease) -> Result<GrantedLease, ServiceError> {
        create_column_lease(&self.writer, &self.audits.threads, request).await
    }

    /// Grants a lease of one group to a rollout worker, and returns the run's policy with it. It waits as [`Self::lease`] does.
    ///
    /// # Errors
    /// Returns the errors of [`Self::lease`], and [`ServiceError::Paused`] if the run has no policy any more.
    pub async fn lease_for_rollout(&self, run: &RunId) -> Result<RolloutLease, ServiceError> {
        self.when_ready(run, || self.writer.change(LeaseRolloutGroup { run: run.clone() })).await
    }

    /// Repeats `attempt` until it succeeds, each time scenarios were prepared, in order with the other requests of the run.
    async fn when_ready<T, F>(&self, run: &RunId, attempt: impl Fn() -> F) -> Result<T, ServiceError>
    where
        F: Future<Output = Result<Option<T>, ServiceError>>,
    {
        let gate = self.gates.of(run);
        let mut ready = self.ready.clone();
        let waiting = async {
            let _permit = gate.lock().await;
            loop {
                ready.mark_unchanged();
                if let Some(granted) = attempt().await? {
                    return Ok(granted);
                }
                self.check_storage()?;
                ready.changed().await.map_err(|_| ServiceError::Stopping)?;
            }
        };
        match tokio::time::timeout(PREPARE_TIMEOUT, waiting).await {
            Ok(granted) => granted,
            Err(_) => self.check_storage().and(Err(ServiceError::NotReady)),
        }
    }

    /// Fails during an outage of the database: prepared scenarios cannot be stored.
    fn check_storage(&self) -> Result<(), ServiceError> {
        self.writer.health().outage().map_or(Ok(()), |outage| Err(ServiceError::unavailable(outage)))
    }

    /// Replays the episodes that an actor reports, and stores their results. The receipts are returned after the commit.
    ///
    /// # Errors
    /// Returns [`ServiceError::UnknownRun`], [`ServiceError::Invalid`] if `policy_version` is far above the newest version of the run,
    /// or an error of the store. Results that were written before the error are kept, and are
    /// answered as duplicates when they are reported again. A report that is wrong is refused in its receipt.
    pub async fn submit_results(
        &self,
        run: RunId,
        actor: Actor,
        policy_version: Option<u32>,
        reported: Vec<ReportedEpisode>,
    ) -> Result<ReportReceipts, ServiceError> {
        let mut turn = self.report_order.enter(&run);
        let CompletedAudit { report, receipt } = self.replay(&run, actor, policy_version, reported).await?;
        turn.wait().await;
        let AuditedReport { mut episodes, mut brackets } = report;
        if actor != Actor::Server {
            self.mark_session_episodes(&mut episodes);
        }
        let mut answer = ReportReceipts::default();
        let mut episodes = episodes.into_iter();
        loop {
            let part: Vec<_> = episodes.by_ref().take(RESULTS_PER_CHANGE).collect();
            let report = AuditedReport { episodes: part, brackets: std::mem::take(&mut brackets) };
            let stored =
                self.writer.change(StoreResults { run: run.clone(), policy_version, report }).await?;
            answer.receipts.extend(stored.receipts);
            answer.summary.add(stored.summary);
            if episodes.len() == 0 {
                receipt.acknowledge();
                return Ok(answer);
            }
        }
    }

    /// Replays episodes that the server ran, without storing anything.
    ///
    /// # Errors
    /// Returns [`ServiceError::UnknownRun`], or an error of the store.
    pub async fn replay_results(
        &self,
        run: &RunId,
        reported: Vec<ReportedEpisode>,
    ) -> Result<CompletedAudit, ServiceError> {
        self.replay(run, Actor::Server, None, reported).await
    }

    /// Marks reported episodes that a session runs.
    fn mark_session_episodes(&self, episodes: &mut [AuditedEpisode]) {
        let keys = episodes.iter().filter_map(|episode| episode.key);
        let running = self.session_episodes.running_among(keys);
        for episode in episodes.iter_mut() {
            episode.is_in_session = episode.key.is_some_and(|key| running.contains(&key));
        }
    }

    async fn replay(
        &self,
        run: &RunId,
        actor: Actor,
        policy_version: Option<u32>,
        reported: Vec<ReportedEpisode>,
    ) -> Result<CompletedAudit, ServiceError> {
        let mut conn = self.readers.acquire().await?;
        let row = runs::get(&mut conn, run.as_str()).await?;
        let row = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
        if let Some(version) = policy_version {
            check_version_step("policy_version", version, row.policy_version)?;
        }
        let settings: RunSettings = from_json("a run's settings", &row.settings)?;
        audit(&mut conn, &self.audits, run, actor, settings, reported).await
    }
}
