//! Leases of sessions that run episodes for a run: they are taken, renewed, reported and released like a trainer's leases.
//!
//! Start reading at [`SessionLeases::reserve`]. [`pool`] has the episodes of one lease, [`reservation`] one episode while a
//! session runs it, [`run_end`] tells sessions that their run was deleted.

mod attempts;
pub(super) mod pool;
mod reservation;
mod run_end;
mod stored_lease;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use api_types::ResultReceipt;
use parking_lot::Mutex;
use store::ids::{EpisodeId, LeaseId, RunId};
use store::leases::{Disclosure, Purpose};
use store::principals::PrincipalId;
use store::step_verdicts::StepVerdictRow;
use store::{StoreError, episodes, from_json, to_u32};
use tokio::sync::OnceCell;
use tokio::task::JoinSet;
use tokio::time::Instant;

use self::pool::{EpisodePool, PooledEpisode};
pub(super) use self::reservation::EpisodeReservation;
use self::run_end::{RunEnd, RunEnds};
use self::stored_lease::{find_active, find_run, load_groups};
use super::session_request::EpisodeSource;
use crate::engine::error::ServiceError;
use crate::leases::create::{CreateLease, OwnerQuota};
use crate::leases::lease_service::LeaseService;
use crate::leases::renew::RenewLease;
use crate::ownership::{self, Actor, RunPermission, check_lease};
use crate::results::reported::ReportedEpisode;
use crate::results::store_verdict::StoreVerdict;
use crate::runs::settings::RunSettings;
use crate::runs::version_step::check_version_step;

/// Time after which a session's own lease expires without a renewal, in seconds.
pub const SESSION_LEASE_TTL_S: u32 = 600;
/// Maximum number of retries of a report while the server is busy or the database is locked: one minute.
const MAX_REPORT_RETRIES: u32 = 240;
/// Pause before each retry of a report.
const REPORT_RETRY_DELAY: Duration = Duration::from_millis(250);
/// Maximum duration of the wait for background work at shutdown.
const PENDING_WORK_TIMEOUT: Duration = Duration::from_secs(2);

/// Pool that several sessions share.
pub(crate) type SharedPool = Arc<Mutex<EpisodePool>>;

/// Key of a shared pool.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum PoolKey {
    /// Run, principal of the clients, and name of a group: its sessions share one lease that the server takes.
    Group(RunId, Option<PrincipalId>, String),
    /// Lease that a client took.
    Lease(RunId, LeaseId),
}

impl PoolKey {
    /// Returns the id of the run.
    const fn run(&self) -> &RunId {
        match self {
            Self::Group(run, ..) | Self::Lease(run, _) => run,
        }
    }
}

/// Leases of all sessions.
#[derive(Debug)]
pub(crate) struct SessionLeases {
    lease_service: LeaseService,
    /// True if sessions may run episodes of runs.
    allow_runs: bool,
    pools: Mutex<HashMap<PoolKey, Arc<OnceCell<SharedPool>>>>,
    run_ends: RunEnds,
    /// Background work that must end before the service stops: releases and reports.
    pending: Mutex<JoinSet<()>>,
}

/// Returns the error of a session that may not run episodes of runs.
pub(super) fn runs_not_allowed() -> ServiceError {
    ServiceError::invalid("run", "sessions of this server cannot run episodes of runs")
}

impl SessionLeases {
    /// Creates the manager without leases.
    pub(super) fn new(lease_service: LeaseService, allow_runs: bool) -> Self {
        let (pools, run_ends, pending) = (Mutex::default(), RunEnds::default(), Mutex::default());
        Self { lease_service, allow_runs, pools, run_ends, pending }
    }

    /// Returns the service that grants leases and accepts results.
    fn lease_service(&self) -> &LeaseService {
        &self.lease_service
    }

    /// Reserves an episode of a run or of a lease for a client.
    ///
    /// # Errors
    /// Returns an error if sessions may not use runs, the client may not use this run or lease, no lease can be taken, or the lease has no matching free episode.
    pub(super) async fn reserve(
        self: &Arc<Self>,
        source: EpisodeSource,
        actor: Actor,
    ) -> Result<EpisodeReservation, ServiceError> {
        if !self.allow_runs {
            return Err(runs_not_allowed());
        }
        if let EpisodeSource::Run { run, policy_version, .. }
        | EpisodeSource::Lease { run, policy_version, .. } = &source
        {
            self.check_run(actor, run, *policy_version).await?;
        }
        match source {
            EpisodeSource::Scenario(_) => Err(ServiceError::invalid("run", "it is missing")),
            EpisodeSource::Run { run, group: None, group_size, policy_version } => {
                let pool = self.lease_group(run, Some(group_size.unwrap_or(1)), policy_version).await?;
                let is_exclusive = group_size.is_none();
                let reserved = self.reserve_in(Arc::new(Mutex::new(pool)), None, None, is_exclusive);
                reserved.map(|episode| episode.with_policy_version(policy_version))
            }
            EpisodeSource::Run { run, group: Some(group), group_size, policy_version } => {
                let cell = self.pool_cell(PoolKey::Group(run.clone(), actor.principal(), group.clone()));
                let lease = || async {
                    let pool = self.lease_group(run, group_size, policy_version).await?;
                    Ok::<_, ServiceError>(Arc::new(Mutex::new(pool)))
                };
                let pool = Arc::clone(cell.get_or_try_init(lease).await?);
                check_group_size(&pool, &group, group_size)?;
                let reserved = self.reserve_in(pool, Some(&group), None, false);
                reserved.map(|episode| episode.with_policy_version(policy_version))
            }
            EpisodeSource::Lease { run, lease, group, episode, policy_version } => {
                let pool = self.lease_pool(run, lease, actor).await?;
                let unbegun = pool.lock().unbegun_group(group.as_deref(), episode.as_ref());
                self.begin(&pool, unbegun.into_iter().collect()).await?;
                let reserved = self.reserve_in(pool, group.as_deref(), episode.as_ref(), false);
                reserved.map(|episode| episode.with_policy_version(policy_version))
            }
        }
    }

    /// Returns the pool of a lease that a client took; all sessions with episodes of the lease share it.
    ///
    /// # Errors
    /// Returns an error if sessions may not use runs, the lease is unknown, over or another principal's, or its episodes are columns.
    pub(super) async fn lease_pool(
        &self,
        run: RunId,
        lease: LeaseId,
        actor: Actor,
    ) -> Result<SharedPool, ServiceError> {
        if !self.allow_runs {
            return Err(runs_not_allowed());
        }
        let cell = self.pool_cell(PoolKey::Lease(run.clone(), lease.clone()));
        let load = || async {
            let run_end = self.run_ends.of(&run);
            let pool = self.load_pool(run.clone(), lease.clone(), run_end).await?;
            Ok::<_, ServiceError>(Arc::new(Mutex::new(pool)))
        };
        let pool = Arc::clone(cell.get_or_try_init(load).await?);
        // A known lease may have ended since it was loaded, or its trainer may have reported episodes.
        let mut conn = self.lease_service.readers.acquire().await.map_err(StoreError::from)?;
        let row = find_active(&mut conn, &run, &lease).await?;
        check_lease(actor, &row)?;
        let reported = episodes::reported(&mut conn, row.id).await?.into_iter().collect();
        pool.lock().remove_reported(&reported);
        Ok(pool)
    }

    /// Checks that an actor may take part in a run, and the policy version that its request names.
    pub(super) async fn check_run(
        &self,
        actor: Actor,
        run: &RunId,
        policy_version: Option<u32>,
    ) -> Result<(), ServiceError> {
        let mut conn = self.lease_service.readers.acquire().await.map_err(StoreError::from)?;
        ownership::check_run(&mut conn, actor, run, RunPermission::TakePart).await?;
        let Some(version) = policy_version else { return Ok(()) };
        check_version_step("policy_version", version, find_run(&mut conn, run).await?.policy_version)
    }

    /// Ends the episodes of a deleted run, and forgets its pools.
    pub(super) fn end_run(&self, run: &RunId) {
        self.run_ends.set(run);
        self.pools.lock().retain(|key, _| key.run() != run);
    }

    /// Renews a lease if a third of its time is over. A failure is logged.
    pub(super) async fn renew(&self, pool: &SharedPool) {
        let (run, lease, previous) = {
            let mut pool = pool.lock();
            if pool.run_end.is_deleted() || pool.renewed_at.elapsed() < pool.ttl / 3 {
                return;
            }
            let previous = std::mem::replace(&mut pool.renewed_at, Instant::now());
            (pool.run.clone(), pool.lease.clone(), previous)
        };
        let renew = RenewLease { run, lease: lease.clone(), actor: Actor::Server };
        if let Err(error) = self.lease_service.writer.change(renew).await {
            if error.is_temporary() {
                pool.lock().renewed_at = previous; // the next step tries again
            }
            tracing::warn!(%lease, %error, "The lease of a session could not be renewed.");
        }
    }

    /// Reports finished episodes of a pool; retries for a while if the server is busy.
    ///
    /// # Errors
    /// Returns the last error of the report.
    pub(super) async fn report(
        &self,
        pool: &SharedPool,
        claims: &[ReportedEpisode],
    ) -> Result<Vec<ResultReceipt>, ServiceError> {
        let run = pool.lock().run.clone();
        let mut retries = 0;
        loop {
            let reported = match self.store_abandoned(pool).await {
                Ok(()) => {
                    let (run, claims) = (run.clone(), claims.to_vec());
                    self.lease_service.submit_results(run, Actor::Server, None, claims).await
                }
                Err(error) => Err(error),
            };
            match reported {
                Err(error) if error.is_temporary() && retries < MAX_REPORT_RETRIES => {
                    retries += 1;
                    tokio::time::sleep(REPORT_RETRY_DELAY).await;
                }
                result => {
                    pool.lock().end_episodes(claims);
                    return result.map(|answer| answer.receipts);
                }
            }
        }
    }

    /// Stores a verdict. A failure is logged, and the episode goes on.
    pub(super) async fn store_verdict(&self, verdict: StepVerdictRow) {
        if let Err(error) = self.lease_service.writer.change(StoreVerdict(verdict)).await {
            tracing::warn!(%error, "A verdict could not be stored.");
        }
    }

    /// Spawns work that must end before the service stops.
    pub(super) fn spawn_tracked(&self, work: impl Future<Output = ()> + Send + 'static) {
        let Ok(runtime) = tokio::runtime::Handle::try_current() else { return };
        let mut pending = self.pending.lock();
        while pending.try_join_next().is_some() {} // forgets finished work
        pending.spawn_on(work, &runtime);
    }

    /// Waits, for two seconds at most, until all tracked work has ended.
    pub(super) async fn wait_for_pending(&self) {
        let mut pending = std::mem::take(&mut *self.pending.lock());
        let all = async { while pending.join_next().await.is_some() {} };
        if tokio::time::timeout(PENDING_WORK_TIMEOUT, all).await.is_err() {
            tracing::warn!("Some leases of sessions could not be released in time; they will expire.");
        }
    }

    /// Takes an episode of a pool.
    fn reserve_in(
        self: &Arc<Self>,
        pool: SharedPool,
        group: Option<&str>,
        episode: Option<&EpisodeId>,
        is_exclusive: bool,
    ) -> Result<EpisodeReservation, ServiceError> {
        let field = match (episode, group) {
            (Some(_), _) => "episode_id",
            (None, Some(_)) => "group_id",
            (None, None) => "lease_id",
        };
        let (run, lease, judge, run_end, taken) = {
            let mut pool = pool.lock();
            let taken = pool.take(group, episode);
            let taken = taken.map_err(|error| ServiceError::invalid(field, error.to_string()))?;
            (pool.run.clone(), pool.lease.clone(), pool.judge, pool.run_end.clone(), taken)
        };
        let PooledEpisode { index, scenario } = taken;
        Ok(EpisodeReservation {
            leases: Arc::clone(self),
            pool,
            run,
            episode: EpisodeId { lease, index },
            scenario,
            judge,
            policy_version: None,
            is_exclusive,
            is_reported: false,
            run_end,
        })
    }

    /// Returns the cell of a shared pool and forgets pools that are neither in use nor leased.
    fn pool_cell(&self, key: PoolKey) -> Arc<OnceCell<SharedPool>> {
        let mut pools = self.pools.lock();
        pools.retain(|_, cell| {
            Arc::strong_count(cell) > 1 || cell.get().is_some_and(|pool| !pool.lock().is_expired())
        });
        Arc::clone(pools.entry(key).or_default())
    }

    /// Takes a lease of one group.
    async fn lease_group(
        &self,
        run: RunId,
        group_size: Option<u32>,
        policy_version: Option<u32>,
    ) -> Result<EpisodePool, ServiceError> {
        let policy_version = match policy_version {
            Some(version) => version,
            None => self.current_policy_version(&run).await?,
        };
        let request = CreateLease {
            run: run.clone(),
            groups: 1,
            group_size,
            policy_version,
            ttl_s: SESSION_LEASE_TTL_S,
            purpose: Purpose::Train,
            owner: Some(OwnerQuota::SERVER),
            refill: false,
            evaluation: None,
            disclosure: Disclosure::Lease,
        };
        let run_end = self.run_ends.of(&run);
        let granted = self.lease_service.lease(request).await?;
        self.load_pool(run, granted.row.lease_id(), run_end).await
    }

    async fn current_policy_version(&self, run: &RunId) -> Result<u32, ServiceError> {
        let mut conn = self.lease_service.readers.acquire().await.map_err(StoreError::from)?;
        Ok(to_u32(find_run(&mut conn, run).await?.policy_version))
    }

    /// Loads the pool of a stored lease, without the episodes that were reported.
    async fn load_pool(
        &self,
        run: RunId,
        lease: LeaseId,
        run_end: RunEnd,
    ) -> Result<EpisodePool, ServiceError> {
        let mut conn = self.lease_service.readers.acquire().await.map_err(StoreError::from)?;
        let row = find_active(&mut conn, &run, &lease).await?;
        if row.is_columns() {
            let reason = "is a lease of columns, which the trainer rolls out itself; create a lease with `form: groups`";
            return Err(ServiceError::invalid("lease_id", reason));
        }
        let groups = load_groups(&mut conn, &row).await?;
        let stored = find_run(&mut conn, &run).await?;
        let settings: RunSettings = from_json("a run's settings", &stored.settings)?;
        Ok(EpisodePool {
            run,
            lease,
            group_size: row.group_size,
            ttl: Duration::from_millis(u64::try_from(row.ttl_ms).unwrap_or_default()),
            renewed_at: Instant::now(),
            judge: settings.judge,
            run_end,
            groups,
            abandoned: Vec::new(),
            running: Arc::clone(&self.lease_service.session_episodes),
        })
    }
}

/// Checks the group size of a request against the group that another session opened.
fn check_group_size(pool: &SharedPool, group: &str, wanted: Option<u32>) -> Result<(), ServiceError> {
    let size = pool.lock().group_size;
    match wanted {
        Some(wanted) if i64::from(wanted) != size => {
            let reason = format!("must be {size}, the size of the open group {group:?}, got {wanted}");
            Err(ServiceError::invalid("group_size", reason))
        }
        _ => Ok(()),
    }
}
