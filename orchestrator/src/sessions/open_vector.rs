//! Opening of vector sessions by the manager.

use std::collections::HashSet;
use std::sync::Arc;

use env_core::TaskSpec;
use env_core::batch::{BatchConfig, BatchError, MAX_ENVS};
use uuid::Uuid;

use super::client::ClientIdentity;
use super::manager::SessionManager;
use super::session_leases::pool::EpisodePool;
use super::session_leases::{SharedPool, runs_not_allowed};
use super::session_request::{EpisodeSource, SessionRequestError};
use super::vector::plan::{PlannedBatch, VectorPlan};
use super::vector::{
    EnvBatch, EpisodeReporter, LastFrame, LeaseAssigner, LeaseBinding, VectorError, VectorRequest,
    VectorSession, VectorSource, run_on,
};
use crate::limits::QuotaPermit;
use crate::ownership::Actor;

/// Maximum number of recipes of a lease that are measured.
const MAX_MEASURED_RECIPES: usize = 64;

/// Plan with the source of its scenarios.
struct SourcedPlan {
    plan: VectorPlan,
    source: VectorSource,
    /// Pool of the lease; `None` without a lease.
    pool: Option<SharedPool>,
    /// Version of the policy that acts; `None` for the version of the lease.
    policy_version: Option<u32>,
}

impl SessionManager {
    /// Opens a vector session and resets its environments.
    ///
    /// # Errors
    /// Returns an error if the request is invalid, the quota or the memory is exhausted, the lease has no free episode, or a
    /// scenario cannot start.
    pub async fn open_vector(
        &self,
        client: &ClientIdentity,
        request: VectorRequest,
        source: EpisodeSource,
    ) -> Result<VectorSession, VectorError> {
        if request.envs == 0 || request.envs > MAX_ENVS {
            let reason = format!("must be from 1 to {MAX_ENVS}, got {}", request.envs);
            return Err(invalid("vector.envs", reason));
        }
        if cfg!(target_endian = "big") {
            return Err(invalid(
                "vector",
                "is not supported: frames are little-endian, but the server is big-endian",
            ));
        }
        let permit = self.acquire_vector_permit(client, &source)?;
        let planned = self.plan_vector(&request, source, client.actor).await?;
        let SourcedPlan { mut plan, source, pool, policy_version } = planned;
        let measure = move || plan.measure().map(|measured| (plan, measured));
        let (plan, measured) = run_on(&self.threads, measure).await.ok_or(VectorError::Lost)??;
        let (task, layout) = (plan.task, plan.layout(measured.shape)?);
        let memory = self.reserve_memory(plan.memory_bytes(measured, layout))?;
        let (autoreset, assigner_pool) = (request.autoreset, pool.clone());
        let create = move || {
            let PlannedBatch { batch, assigned } = plan.create_batch()?;
            let assigner = assigned.zip(assigner_pool).map(|(assigned, pool)| {
                let assigner = LeaseAssigner::new(pool, task.id(), assigned, measured.shape, autoreset);
                assigner.with_policy_version(policy_version)
            });
            let mut batch = Box::new(EnvBatch::new(batch, layout, assigner));
            let bytes = batch.reset(0, None)?;
            Ok::<_, BatchError>((batch, bytes))
        };
        let (batch, bytes) = run_on(&self.threads, create).await.ok_or(VectorError::Lost)??;
        Ok(VectorSession {
            token: Uuid::new_v4().to_string(),
            task,
            autoreset,
            layout,
            columns: batch.columns(),
            batch: Some(batch),
            steps: 0,
            last_frame: LastFrame { sequence: 0, bytes },
            threads: Arc::clone(&self.threads),
            lease: self.bind_lease(&source, pool),
            source,
            _permit: permit,
            _memory: memory,
        })
    }

    /// Takes a permit for a client that may use the source.
    fn acquire_vector_permit(
        &self,
        client: &ClientIdentity,
        source: &EpisodeSource,
    ) -> Result<QuotaPermit, VectorError> {
        if !client.may_use_runs && !matches!(source, EpisodeSource::Scenario(_)) {
            return Err(runs_not_allowed().into());
        }
        Ok(self.acquire_permit(client)?)
    }

    async fn plan_vector(
        &self,
        request: &VectorRequest,
        source: EpisodeSource,
        actor: Actor,
    ) -> Result<SourcedPlan, VectorError> {
        let config = BatchConfig::new(request.envs, request.autoreset, request.observe);
        match source {
            EpisodeSource::Scenario(_) if request.task.is_some() => {
                Err(invalid("vector.task", "needs `lease_id`; without a lease, send `task` beside `vector`"))
            }
            EpisodeSource::Scenario(scenario) => {
                let (task, seed) = (scenario.task(), scenario.seed().get());
                let plan = VectorPlan { task, config, scenarios: vec![scenario], is_leased: false };
                let source = VectorSource::Recipe { seed };
                Ok(SourcedPlan { plan, source, pool: None, policy_version: None })
            }
            EpisodeSource::Run { .. } => {
                Err(invalid("lease_id", "is required for a vector session of a run; create a lease first"))
            }
            EpisodeSource::Lease { group: Some(_), .. } => {
                Err(invalid("group_id", "must be left out: a vector session runs all episodes of a lease"))
            }
            EpisodeSource::Lease { episode: Some(_), .. } => {
                Err(invalid("episode_id", "must be left out: a vector session runs all episodes of a lease"))
            }
            EpisodeSource::Lease { run, lease, policy_version, .. } => {
                self.leases.check_run(actor, &run, policy_version).await?;
                let pool = self.leases.lease_pool(run.clone(), lease.clone(), actor).await?;
                let plan = plan_pool(&pool.lock(), config, request.task)?;
                // Each environment starts with an episode.
                self.leases.begin_for_task(&pool, plan.task.id(), config.envs).await?;
                let source = VectorSource::Lease { run, lease };
                Ok(SourcedPlan { plan, source, pool: Some(pool), policy_version })
            }
        }
    }

    /// Starts the reporter of a leased session.
    fn bind_lease(&self, source: &VectorSource, pool: Option<SharedPool>) -> Option<LeaseBinding> {
        let (VectorSource::Lease { .. }, Some(pool)) = (source, pool) else { return None };
        let reporter = EpisodeReporter::start(&self.leases, &pool);
        Some(LeaseBinding { leases: Arc::clone(&self.leases), pool, reporter })
    }
}

/// Plans the free episodes of a lease. One scenario of each recipe is measured.
fn plan_pool(
    pool: &EpisodePool,
    config: BatchConfig,
    requested_task: Option<&'static dyn TaskSpec>,
) -> Result<VectorPlan, VectorError> {
    let mut tasks: Vec<&'static dyn TaskSpec> = Vec::new();
    for group in pool.free_groups() {
        if tasks.iter().all(|task| task.id() != group.scenario.task().id()) {
            tasks.push(group.scenario.task());
        }
    }
    let task = select_task(&tasks, requested_task)?;
    let mut recipes = HashSet::new();
    let scenarios = pool
        .free_groups()
        .map(|group| &group.scenario)
        .filter(|scenario| scenario.task().id() == task.id())
        .filter(|scenario| recipes.insert(Arc::as_ptr(scenario.recipe())));
    let scenarios = scenarios.take(MAX_MEASURED_RECIPES).cloned().collect();
    Ok(VectorPlan { task, config, scenarios, is_leased: true })
}

/// Selects the requested task of a lease, or its only one.
fn select_task(
    tasks: &[&'static dyn TaskSpec],
    requested: Option<&'static dyn TaskSpec>,
) -> Result<&'static dyn TaskSpec, VectorError> {
    let known = || tasks.iter().map(|task| task.id()).collect::<Vec<_>>().join(", ");
    match (tasks, requested) {
        ([], _) => Err(invalid(
            "lease_id",
            "all episodes of the lease are finished or running; create another lease",
        )),
        (tasks, Some(requested)) => {
            let found = tasks.iter().find(|task| task.id() == requested.id());
            found
                .copied()
                .ok_or_else(|| invalid("vector.task", format!("must be a task of the lease: {}", known())))
        }
        ([task], None) => Ok(*task),
        (_, None) => {
            let reason = format!("is required, because the lease has several tasks: {}", known());
            Err(invalid("vector.task", reason))
        }
    }
}

fn invalid(field: &str, reason: impl Into<String>) -> VectorError {
    SessionRequestError::new(field, reason).into()
}
