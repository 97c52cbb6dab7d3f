//! Builds the queue of jobs of a service: its own threads, and workers on other machines if they are configured.

use std::path::Path;
use std::sync::Arc;

use job_queue::nats::server::{NatsQueue, NatsQueueConfig};
use job_queue::{JobQueue, LocalQueue, QueuePools};
use rayon::ThreadPoolBuildError;
use store::to_u64;

use super::config::{Config, RemoteWorkersConfig};
use crate::results::audit::AuditEngine;
use crate::results::report_order::ReportOrder;
use crate::threads::{self, ThreadPriority};
use crate::workers::{FeedServer, MAX_PREPARE_JOBS, RemoteQueue};

/// Queue of a service, with everything that depends on where its jobs are done.
pub(super) struct ServiceQueue {
    pub(super) audits: AuditEngine,
    pub(super) report_order: ReportOrder,
    /// Workers on other machines, if they are configured.
    pub(super) remote: Option<RemoteQueue>,
}

/// Starts the queue. A service without background work has threads for replays only.
pub(super) fn start(config: &Config) -> Result<ServiceQueue, ThreadPoolBuildError> {
    let audit = threads::pool("replay", 0, ThreadPriority::Bulk)?;
    let pools = if config.process_token.is_none() {
        QueuePools {
            prepare: threads::pool("prepare", MAX_PREPARE_JOBS, ThreadPriority::Bulk)?,
            audit: Arc::clone(&audit),
            critique: threads::pool("critique", threads::half_of_cores(), ThreadPriority::Background)?,
        }
    } else {
        QueuePools { prepare: Arc::clone(&audit), audit: Arc::clone(&audit), critique: Arc::clone(&audit) }
    };
    let local = LocalQueue::new(pools);
    let Some(RemoteWorkersConfig { nats, verified_share, min_job, patience }) = config.remote_workers.clone()
    else {
        let audits = AuditEngine { threads: audit, queue: Arc::new(local) };
        return Ok(ServiceQueue { audits, report_order: ReportOrder::default(), remote: None });
    };
    let epoch = to_u64(config.clock.now());
    let server = server_name(&config.db);
    let config = NatsQueueConfig { nats, server, epoch, verified_share, min_job, patience };
    let (queue, notices) = NatsQueue::start(config, local);
    let remote = RemoteQueue { notices, designs: queue.designs(), rollouts: queue.rollouts() };
    let queue: Arc<dyn JobQueue> = Arc::new(queue);
    let audits = AuditEngine { threads: audit, queue };
    Ok(ServiceQueue { audits, report_order: ReportOrder::of_arrival(), remote: Some(remote) })
}

/// Returns where trajectory feeds are published; `None` without NATS.
pub(super) fn feed_server(config: &Config) -> Option<FeedServer> {
    let RemoteWorkersConfig { nats, .. } = config.remote_workers.clone()?;
    Some(FeedServer { nats, name: server_name(&config.db) })
}

/// Name of the server of a database: the same after a restart, and different for each database of each host.
fn server_name(db: &Path) -> String {
    let path = db.canonicalize().unwrap_or_else(|_| db.to_owned());
    let host = job_queue::host_name();
    let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 server name");
    hasher.update(host.as_bytes()).update(&[0]).update(path.as_os_str().as_encoded_bytes());
    let digest = hasher.finalize().to_hex();
    format!("{}-{}", host.chars().take(32).collect::<String>(), &digest.as_str()[..8])
}
