//! Rolls out the policies of runs, group by group, as long as their feeds have room. If a policy fails, its run continues, and the
//! failure is stored for display.

mod backoff;
mod group_rollout;
mod placement;

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use job_queue::nats::server::RolloutQueue;
use jobs::JobKind;
use rollout::PolicySources;
use sqlx::SqlitePool;
use store::ids::RunId;
use store::run_policies::{self, RunPolicyRow};
use store::{from_json, runs, trajectories};
use tokio::sync::{Notify, Semaphore};
use tokio::task::{Id, JoinError, JoinSet};

use self::backoff::RunBackoff;
use self::group_rollout::GroupRolloutStatus;
use self::placement::{MAX_BUILT_IN_GROUPS, Placement, RolloutPlace, rollout_kind};
use crate::engine::error::ServiceError;
use crate::leases::lease_service::LeaseService;
use crate::rollouts::feed::MAX_UNACKED_BYTES;
use crate::rollouts::rollout_lease::ReturnAbandonedLeases;
use crate::rollouts::settings::SetPolicyError;
use crate::rollouts::settings::settings_from_row;
use crate::runs::settings::RunSettings;
use crate::workers::round_error::ends_worker;
use clock::{Clock, Millis};

/// Interval between two checks whether a group may start, if no signal arrives.
const POLL_INTERVAL: Duration = Duration::from_secs(1);
/// Pause after an error of the worker itself.
const ERROR_PAUSE: Duration = Duration::from_secs(2);

/// Worker that rolls out the policies of runs.
#[derive(Debug, Clone)]
pub(super) struct RolloutWorker {
    /// Service that grants leases and takes results.
    pub lease_service: LeaseService,
    /// Pool of connections that read.
    pub readers: SqlitePool,
    /// Source of the current time.
    pub clock: Clock,
    /// Signal that a group may be due.
    pub wake: Arc<Notify>,
    /// Policies of this server.
    pub policies: PolicySources,
    /// Threads of this worker, at background priority.
    pub pool: Arc<rayon::ThreadPool>,
    /// Permits of groups on these threads.
    pub permits: Arc<Semaphore>,
    /// Workers on other machines, if they are configured.
    pub remote: Option<RolloutQueue>,
}

/// Load that a group puts on a machine or on a language model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct RolloutLoad {
    place: RolloutPlace,
    kind: JobKind,
    /// Episodes of a language model; 1 for a group of another policy.
    amount: usize,
}

/// A group that is being rolled out.
struct ActiveGroup {
    run: String,
    /// When the run's policy was set.
    policy_set_at: Millis,
    load: RolloutLoad,
}

/// Groups that are being rolled out.
#[derive(Default)]
struct ActiveGroups {
    jobs: JoinSet<GroupRolloutStatus>,
    by_job: HashMap<Id, ActiveGroup>,
    backoff: RunBackoff,
    /// The run that was served last: the next one comes first.
    last_run: String,
}

impl RolloutWorker {
    /// Creates the permits of groups on the worker's threads.
    pub(super) fn group_permits() -> Arc<Semaphore> {
        Arc::new(Semaphore::new(MAX_BUILT_IN_GROUPS))
    }

    /// Runs until the writer stops.
    pub(super) async fn run(self) {
        let mut active = ActiveGroups::default();
        let mut has_recovered = false;
        loop {
            match self.start_due(&mut active, &mut has_recovered).await {
                Ok(()) => {}
                Err(error) if ends_worker(&error, "policies could not be rolled out") => return,
                Err(_) => tokio::time::sleep(ERROR_PAUSE).await,
            }
            tokio::select! {
                Some(ended) = active.jobs.join_next_with_id() => active.remove(ended),
                () = self.wake.notified() => {}
                () = tokio::time::sleep(POLL_INTERVAL) => {}
            }
        }
    }

    /// Starts the groups that are due, run by run in turn. The first call returns the leases that the last server left.
    async fn start_due(
        &self,
        active: &mut ActiveGroups,
        has_recovered: &mut bool,
    ) -> Result<(), ServiceError> {
        if !*has_recovered {
            let returned = self.lease_service.writer.change(ReturnAbandonedLeases).await?;
            *has_recovered = true;
            if returned > 0 {
                tracing::info!(returned, "Rollouts that the last shutdown interrupted are offered again.");
            }
        }
        loop {
            let mut rows = {
                let mut conn = self.readers.acquire().await?;
                run_policies::active(&mut conn).await?
            };
            let first = rows.partition_point(|row| row.run <= active.last_run);
            rows.rotate_left(first);
            let mut started = false;
            for row in rows {
                if let Some(load) = self.due_load(active, &row).await? {
                    active.last_run.clone_from(&row.run);
                    self.start(active, &row, load)?;
                    started = true;
                }
            }
            if !started {
                return Ok(());
            }
        }
    }

    /// Returns the load of the next group of a policy; `None` if none may start now.
    async fn due_load(
        &self,
        active: &mut ActiveGroups,
        row: &RunPolicyRow,
    ) -> Result<Option<RolloutLoad>, ServiceError> {
        if active.backoff.is_paused(&row.run, row.changed_at) {
            return Ok(None);
        }
        let placement = self.place(active, row);
        if placement == Placement::Busy {
            return Ok(None);
        }
        let settings = settings_from_row(row)?;
        let mut conn = self.readers.acquire().await?;
        let feed = trajectories::counts(&mut conn, &row.run, self.clock.now()).await?;
        let unacked = feed.waiting + feed.delivered + active.groups_of(&row.run);
        if unacked >= i64::from(settings.max_unacknowledged_groups) || feed.bytes >= MAX_UNACKED_BYTES {
            return Ok(None);
        }
        let place = match placement {
            Placement::Start(place) => place,
            Placement::Busy => return Ok(None),
            Placement::NoModel(error) => {
                drop(conn);
                self.store_error(row, error.to_owned()).await?;
                return Ok(None);
            }
            Placement::ModelAway(error) => {
                drop(conn);
                active.backoff.pause(&row.run, row.changed_at);
                self.store_error(row, error).await?;
                return Ok(None);
            }
        };
        let kind = rollout_kind(&row.policy);
        if kind != JobKind::RolloutChat {
            return Ok(Some(RolloutLoad { place, kind, amount: 1 }));
        }
        let run = runs::get(&mut conn, &row.run).await?;
        let run = run.ok_or_else(|| ServiceError::UnknownRun(row.run.clone()))?;
        let episodes = from_json::<RunSettings>("a run's settings", &run.settings)?.group_size;
        Ok(Some(RolloutLoad { place, kind, amount: episodes as usize }))
    }

    /// Stores why no group of a run is rolled out, unless it is known.
    async fn store_error(&self, row: &RunPolicyRow, error: String) -> Result<(), ServiceError> {
        if row.error.as_ref() != Some(&error) {
            self.lease_service.writer.change(SetPolicyError { run: row.run.clone(), error }).await?;
        }
        Ok(())
    }

    /// Starts a group of a run.
    fn start(
        &self,
        active: &mut ActiveGroups,
        row: &RunPolicyRow,
        load: RolloutLoad,
    ) -> Result<(), ServiceError> {
        let run: RunId = row
            .run
            .parse()
            .map_err(|error: store::ids::InvalidId| ServiceError::invalid("run", error.to_string()))?;
        let worker = self.clone();
        let job = active.jobs.spawn(async move { worker.roll_out_group(run, load.place).await });
        let group = ActiveGroup { run: row.run.clone(), policy_set_at: row.changed_at, load };
        active.by_job.insert(job.id(), group);
        Ok(())
    }
}

impl ActiveGroups {
    /// Returns the load of all groups of a kind at a place.
    fn load(&self, place: RolloutPlace, kind: JobKind) -> usize {
        let loads = self.by_job.values().map(|group| group.load);
        loads.filter(|load| load.place == place && load.kind == kind).map(|load| load.amount).sum()
    }

    fn groups_of(&self, run: &str) -> i64 {
        self.by_job.values().filter(|group| group.run == run).count() as i64
    }

    /// Removes a group that ended, and updates the backoff of its run.
    fn remove(&mut self, ended: Result<(Id, GroupRolloutStatus), JoinError>) {
        let (id, result) = match ended {
            Ok(ended) => ended,
            Err(error) => {
                tracing::error!(error = %error, "The rollout of a group panicked; its lease will expire.");
                (error.id(), GroupRolloutStatus::Failed)
            }
        };
        let Some(group) = self.by_job.remove(&id) else { return };
        match result {
            GroupRolloutStatus::Succeeded => self.backoff.clear(&group.run),
            GroupRolloutStatus::Failed => self.backoff.pause(&group.run, group.policy_set_at),
        }
    }
}
