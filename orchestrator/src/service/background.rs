//! The workers that run beside the server.

use std::sync::Arc;

use tokio::sync::watch;
use tokio::task::JoinSet;

use super::config::{Config, StartError};
use super::thread_pool;
use crate::engine::signals::WorkerSignals;
use crate::leases::lease_service::LeaseService;
use crate::sessions::SessionManager;
use crate::threads::{self, ThreadPriority};
use crate::workers;

/// Spawns all workers. `ready` signals that scenarios were prepared.
///
/// # Errors
/// Returns [`StartError::Threads`] if the threads of a worker cannot be started.
pub(super) fn spawn_workers(
    config: &Config,
    lease_service: &LeaseService,
    signals: WorkerSignals,
    ready: watch::Sender<u64>,
    sessions: &Arc<SessionManager>,
) -> Result<JoinSet<()>, StartError> {
    let LeaseService { writer, readers, .. } = lease_service;
    let mut jobs = JoinSet::new();
    let preparer = workers::prepare::PrepareWorker {
        readers: readers.clone(),
        writer: writer.clone(),
        wake: signals.prepare,
        ready,
        unsolvable: Arc::default(),
        pool: thread_pool("prepare", workers::prepare::MAX_JOBS, ThreadPriority::Bulk)?,
    };
    jobs.spawn(preparer.run());
    jobs.spawn(workers::expire::run(writer.clone()));
    jobs.spawn(workers::clock::run(config.clock.clone(), writer.clone()));
    jobs.spawn(workers::retention::run(readers.clone(), writer.clone()));
    jobs.spawn(workers::delete_runs::run(writer.clone(), signals.delete));
    let evaluation_pool = thread_pool("evaluate", threads::half_of_cores(), ThreadPriority::Background)?;
    jobs.spawn(workers::evaluate::run(readers.clone(), writer.clone(), evaluation_pool));
    jobs.spawn(workers::revoke_connections::run(readers.clone(), config.clock.clone(), Arc::clone(sessions)));
    let critic = workers::critique::CritiqueWorker {
        readers: readers.clone(),
        writer: writer.clone(),
        wake: signals.critique,
        pool: thread_pool("critique", threads::half_of_cores(), ThreadPriority::Background)?,
    };
    jobs.spawn(critic.run());
    let designer = workers::design::DesignWorker {
        readers: readers.clone(),
        writer: writer.clone(),
        wake: signals.design,
        designers: Arc::clone(&config.designers),
    };
    jobs.spawn(designer.run());
    let rollouts = workers::rollout::RolloutWorker {
        lease_service: lease_service.clone(),
        readers: readers.clone(),
        clock: config.clock.clone(),
        wake: signals.rollout,
        endpoint: config.endpoint.clone(),
        pool: thread_pool("rollout", threads::half_of_cores(), ThreadPriority::Background)?,
    };
    jobs.spawn(rollouts.run());
    Ok(jobs)
}
