//! Sessions that fly for a run: an implicit lease each, and the outcome reported like any other.

use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use env_core::{ActionLog, Scenario};
use tokio::sync::OnceCell;
use tokio::task::JoinSet;
use tokio::time::Instant;

use super::pool::{Group, Pool};
use super::wish::Wished;
use crate::ids::{EpisodeId, LeaseId, RunId};
use crate::judging::Judge;
use crate::store::scenarios::Loader;
use crate::store::verdicts::VerdictRow;
use crate::store::{episodes, from_json, groups, runs, small};
use crate::training::audit::{Claim, Claimed};
use crate::training::lease::{Purpose, Release, Renew, TakeLease, find};
use crate::training::receipt::Receipt;
use crate::training::verdict::KeepVerdict;
use crate::training::{Desk, RunSettings, TrainingError};

/// How long an implicit lease holds without a step, seconds.
pub const TTL_S: u32 = 600;
/// Tries at reporting an outcome while the server is busy, and the pause between them.
const TRIES: u32 = 40;
const PAUSE: Duration = Duration::from_millis(250);

/// What several sessions fly together: the group that they named, or a lease that was taken for them.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Together {
    Group(RunId, String),
    Lease(RunId, LeaseId),
}

pub(super) type Held = Arc<Mutex<Pool>>;

/// Leases of sessions.
#[derive(Debug)]
pub(super) struct Leased {
    desk: Desk,
    /// Whether anybody may fly for a run.
    open: bool,
    together: Mutex<HashMap<Together, Arc<OnceCell<Held>>>>,
    /// What is being given back.
    returning: Mutex<JoinSet<()>>,
}

/// An episode of a lease that a session flies. Dropped before its outcome is reported, it is given back.
#[derive(Debug)]
pub(super) struct Ticket {
    leased: Arc<Leased>,
    pool: Held,
    pub(super) run: RunId,
    pub(super) episode: EpisodeId,
    /// Who judges its steps, where the run says so.
    pub(super) judge: Option<Judge>,
    /// The lease was taken for this session alone.
    alone: bool,
    reported: bool,
}

/// Who flies here flies for no runs.
pub(super) fn for_no_runs() -> TrainingError {
    TrainingError::invalid("run", "sessions here fly for no runs")
}

impl Leased {
    pub(super) fn new(desk: Desk, open: bool) -> Self {
        Self { desk, open, together: Mutex::default(), returning: Mutex::default() }
    }

    /// An episode to fly, as it is wished for.
    pub(super) async fn take(self: &Arc<Self>, wished: Wished) -> Result<(Ticket, Scenario), TrainingError> {
        if !self.open {
            return Err(for_no_runs());
        }
        let (pool, group, episode, alone) = match wished {
            Wished::Free(_) => return Err(TrainingError::invalid("run", "it is missing")),
            Wished::Run { run, group: None, group_size, policy_version } => {
                let pool = self.granted(run, Some(group_size.unwrap_or(1)), policy_version).await?;
                (Arc::new(Mutex::new(pool)), None, None, group_size.is_none())
            }
            Wished::Run { run, group: Some(group), group_size, policy_version } => {
                let cell = self.cell(Together::Group(run.clone(), group.clone()));
                let granted = || async {
                    let pool = self.granted(run, group_size, policy_version).await?;
                    Ok::<_, TrainingError>(Arc::new(Mutex::new(pool)))
                };
                (Arc::clone(cell.get_or_try_init(granted).await?), Some(group), None, false)
            }
            Wished::Lease { run, lease, group, episode } => {
                (self.shared(run, lease).await?, group, episode, false)
            }
        };
        let (run, episode, judge, scenario) = {
            let mut held = lock(&pool);
            let field = if episode.is_some() {
                "episode_id"
            } else if group.is_some() {
                "group_id"
            } else {
                "lease_id"
            };
            let taken = held.take(group.as_deref(), episode.as_ref());
            let (index, scenario) =
                taken.map_err(|error| TrainingError::invalid(field, error.to_string()))?;
            (held.run.clone(), EpisodeId { lease: held.lease.clone(), index }, held.judge, scenario)
        };
        let ticket = Ticket { leased: Arc::clone(self), pool, run, episode, judge, alone, reported: false };
        Ok((ticket, scenario))
    }

    /// The episodes of a lease that somebody took, shared by all that fly them here.
    pub(super) async fn shared(&self, run: RunId, lease: LeaseId) -> Result<Held, TrainingError> {
        if !self.open {
            return Err(for_no_runs());
        }
        let cell = self.cell(Together::Lease(run.clone(), lease.clone()));
        let read = || async {
            let pool = self.read(run.clone(), lease.clone()).await?;
            Ok::<_, TrainingError>(Arc::new(Mutex::new(pool)))
        };
        let held = Arc::clone(cell.get_or_try_init(read).await?);
        // It may have ended since others began to fly of it, or be reported in part by other ways.
        let mut conn = self.desk.readers.acquire().await.map_err(crate::store::StoreError::from)?;
        let row = find(&mut conn, &run, &lease).await?;
        if row.status != "active" {
            return Err(TrainingError::LeaseOver { lease: lease.to_string(), status: row.status });
        }
        let reported = episodes::reported(&mut conn, row.id).await?.into_iter().collect();
        lock(&held).forget(&reported);
        Ok(held)
    }

    /// Renews a lease where a third of its time is over.
    pub(super) async fn renew(&self, pool: &Held) {
        let (run, lease, before) = {
            let mut pool = lock(pool);
            if pool.held_since.elapsed() < pool.ttl / 3 {
                return;
            }
            let before = std::mem::replace(&mut pool.held_since, Instant::now());
            (pool.run.clone(), pool.lease.clone(), before)
        };
        if let Err(error) = self.desk.writer.change(Renew { run, lease: lease.clone() }).await {
            if error.is_passing() {
                lock(pool).held_since = before; // it is tried again soon
            }
            tracing::warn!(%lease, %error, "The lease of a session could not be renewed.");
        }
    }

    /// Reports what was flown. While the server is busy it tries again for a while.
    pub(super) async fn report(&self, run: &RunId, claims: &[Claim]) -> Result<Vec<Receipt>, TrainingError> {
        let mut tries = 0;
        loop {
            match self.desk.report(run.clone(), None, claims.to_vec()).await {
                Err(error) if error.is_passing() && tries < TRIES => {
                    tries += 1;
                    tokio::time::sleep(PAUSE).await;
                }
                told => return told.map(|(receipts, _)| receipts),
            }
        }
    }

    /// Does something that has to be done before the service is down.
    pub(super) fn finish(&self, work: impl Future<Output = ()> + Send + 'static) {
        let Ok(runtime) = tokio::runtime::Handle::try_current() else { return };
        let mut returning = self.returning.lock().unwrap_or_else(PoisonError::into_inner);
        while returning.try_join_next().is_some() {} // what is done is forgotten
        returning.spawn_on(work, &runtime);
    }

    /// Keeps what a judge said. Where that cannot be, the log says so, and the episode goes on.
    pub(super) async fn keep(&self, verdict: VerdictRow) {
        if let Err(error) = self.desk.writer.change(KeepVerdict(verdict)).await {
            tracing::warn!(%error, "A verdict could not be kept.");
        }
    }

    /// Where sessions that fly together meet.
    fn cell(&self, together: Together) -> Arc<OnceCell<Held>> {
        let mut all = self.together.lock().unwrap_or_else(PoisonError::into_inner);
        // What is over is forgotten, so that this stays as small as what is leased.
        all.retain(|_, cell| {
            Arc::strong_count(cell) > 1 || cell.get().is_some_and(|held| !lock(held).is_over())
        });
        Arc::clone(all.entry(together).or_default())
    }

    /// A lease of one group, just taken.
    async fn granted(
        &self,
        run: RunId,
        group_size: Option<u32>,
        policy_version: Option<u32>,
    ) -> Result<Pool, TrainingError> {
        let policy_version = match policy_version {
            Some(version) => version,
            None => self.newest_policy(&run).await?,
        };
        let purpose = Purpose::Train;
        let wish = TakeLease {
            run: run.clone(),
            groups: 1,
            group_size,
            policy_version,
            ttl_s: TTL_S,
            purpose,
            owner: None,
            refill: false,
            evaluation: None,
        };
        let granted = self.desk.lease(wish).await?;
        self.read(run, granted.row.lease_id()).await
    }

    async fn newest_policy(&self, run: &RunId) -> Result<u32, TrainingError> {
        let mut conn = self.desk.readers.acquire().await.map_err(crate::store::StoreError::from)?;
        let row = runs::get(&mut conn, run.as_str()).await?;
        let row = row.ok_or_else(|| TrainingError::UnknownRun(run.to_string()))?;
        Ok(small(row.policy_version))
    }

    /// A lease as it is stored: what was reported already is not flown again.
    async fn read(&self, run: RunId, lease: LeaseId) -> Result<Pool, TrainingError> {
        let mut conn = self.desk.readers.acquire().await.map_err(crate::store::StoreError::from)?;
        let row = find(&mut conn, &run, &lease).await?;
        if row.status != "active" {
            return Err(TrainingError::LeaseOver { lease: lease.to_string(), status: row.status });
        }
        if row.is_columns() {
            let why = "its episodes come as ranges of seeds, to be flown elsewhere and claimed in columns";
            return Err(TrainingError::invalid("lease_id", why));
        }
        let reported: BTreeSet<i64> = episodes::reported(&mut conn, row.id).await?.into_iter().collect();
        let rows = groups::of_lease(&mut conn, row.id).await?;
        let ids: Vec<_> = rows.iter().map(|group| &group.scenario).collect();
        let scenarios = Loader::default().all(&mut conn, &ids).await?;
        let mut groups = Vec::new();
        for group in rows {
            let scenario = scenarios.get(&group.scenario)?.clone();
            let first = group.number * row.group_size;
            let free = (first..first + row.group_size).filter(|index| !reported.contains(index)).collect();
            groups.push(Group { number: group.number, scenario, name: None, free });
        }
        let ttl = Duration::from_millis(u64::try_from(row.ttl_ms).unwrap_or_default());
        let stored = runs::get(&mut conn, run.as_str()).await?;
        let stored = stored.ok_or_else(|| TrainingError::UnknownRun(run.to_string()))?;
        let settings: RunSettings = from_json("a run's settings", &stored.settings)?;
        Ok(Pool::new(run, lease, row.group_size, (ttl, Instant::now()), settings.judge, groups))
    }

    /// Waits until all that was given back is.
    pub(super) async fn settle(&self) {
        let mut returning =
            std::mem::take(&mut *self.returning.lock().unwrap_or_else(PoisonError::into_inner));
        let all = async { while returning.join_next().await.is_some() {} };
        if tokio::time::timeout(Duration::from_secs(2), all).await.is_err() {
            tracing::warn!(
                "Some leases of sessions could not be given back in time; they end by themselves."
            );
        }
    }
}

pub(super) fn lock(pool: &Mutex<Pool>) -> MutexGuard<'_, Pool> {
    // Nothing that holds it can panic; if something did, the pool is still a pool.
    pool.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Ticket {
    /// Whether what is wished for is of the same lease or group.
    pub(super) fn is_of(&self, wished: &Wished) -> bool {
        match wished {
            Wished::Lease { run, lease, .. } => *run == self.run && *lease == self.episode.lease,
            Wished::Run { run, group: Some(_), .. } => *run == self.run,
            Wished::Run { .. } | Wished::Free(_) => false,
        }
    }

    /// Renews the lease where a third of its time is over.
    pub(super) async fn renew(&self) {
        self.leased.renew(&self.pool).await;
    }

    /// Reports the episode as flown. While the server is busy it tries again for a while.
    pub(super) async fn report(&mut self, log: &ActionLog) -> Result<Receipt, TrainingError> {
        let claim = Claim {
            episode: self.episode.to_string(),
            what: Claimed::Logged(log.clone()),
            policy_version: None,
            metrics: None,
        };
        let receipts = self.leased.report(&self.run, &[claim]).await?;
        self.reported = true;
        receipts.into_iter().next().ok_or_else(|| TrainingError::invalid("episode", "it was not answered"))
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        if self.reported {
            return;
        }
        lock(&self.pool).give_back(self.episode.index);
        if !self.alone {
            return; // a sibling may fly it, or the lease ends by itself
        }
        let change = Release { run: self.run.clone(), lease: self.episode.lease.clone() };
        let (writer, episode) = (self.leased.desk.writer.clone(), self.episode.clone());
        self.leased.finish(async move {
            if let Err(error) = writer.change(change).await {
                tracing::warn!(%episode, %error, "The lease of a session could not be given back; it ends by itself.");
            }
        });
    }
}
