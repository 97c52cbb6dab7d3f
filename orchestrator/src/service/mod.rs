//! The service as a whole: database, writer, workers, sessions and HTTP, started and stopped together.
//!
//! [`Service::start`] builds every part from a [`Config`] and connects them; `startup` has the steps before the server
//! listens. The parts themselves are in `http`, `workers`, `sessions`, `engine` and `store`.

mod config;
mod service_queue;
mod startup;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use sqlx::SqlitePool;
use store::{DatabaseLock, open_maintenance, open_readers};
use tokio::sync::watch;
use tokio::task::{JoinHandle, JoinSet};

pub use self::config::{Config, RemoteWorkersConfig, StartError};
use self::service_queue::ServiceQueue;
use self::startup::{BoundListener, OpenDatabase};
use crate::engine::error::ServiceError;
use crate::engine::signals::WorkerSignals;
use crate::engine::writer::Writer;
use crate::http::state::AppState;
use crate::http::{self, ApiSurface, ServerTls};
use crate::leases::lease_service::LeaseService;
use crate::limits::constants::{
    MAX_FEED_ANSWERS, MAX_FEED_ANSWERS_PER_CLIENT, MAX_LARGE_BODIES, MAX_LISTENERS, MAX_LISTENERS_PER_CLIENT,
    METRICS_REQUESTS_PER_SECOND,
};
use crate::limits::{BodyLimit, ConcurrencyLimits, LongPollLimit, Quota, RateLimit};
use crate::sessions::{SessionLimits, SessionManager};
use crate::shards::Shards;
use crate::threads::{self, ThreadPriority};
use crate::tokens::Token;
use crate::workers::{self, RemoteQueue, WorkerConfig};

/// Time that running requests and the writer have to finish when the service stops.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(10);

/// Service that is running.
#[derive(Debug)]
pub struct Service {
    address: SocketAddr,
    tls: Option<Arc<ServerTls>>,
    stopping: Arc<AtomicBool>,
    stop: watch::Sender<bool>,
    sessions: Arc<SessionManager>,
    server: JoinHandle<()>,
    workers: JoinSet<()>,
    checkpointer: JoinHandle<()>,
    writer: Writer,
    writer_task: JoinHandle<()>,
    readers: SqlitePool,
    lock: Arc<DatabaseLock>,
}

impl Service {
    /// Opens the database, starts the workers, and listens.
    ///
    /// # Errors
    /// Returns [`StartError`] if the database cannot be opened, the address cannot be used or needs tokens, the certificate cannot
    /// be used, or the system has no threads left.
    pub async fn start(config: Config) -> Result<Self, StartError> {
        http::install_metrics_recorder();
        let tls = config.tls.clone().map(ServerTls::load).transpose()?.map(Arc::new);
        let BoundListener { listener, address } = startup::listen(&config).await?;
        let OpenDatabase { lock, surface, shards, connection } = startup::open_database(&config).await?;
        let readers = open_readers(&config.db).await?;

        let signals = WorkerSignals::default();
        let (writer, writer_task) =
            Writer::start(connection, Some(Arc::clone(&lock)), config.clock.clone(), signals.clone());
        let (ready_sender, ready) = watch::channel(0);
        let (stop, stopped) = watch::channel(false);
        let ServiceQueue { audits, report_order, remote } =
            service_queue::start(&config).map_err(StartError::Threads)?;
        let lease_service = LeaseService {
            writer: writer.clone(),
            readers: readers.clone(),
            ready,
            gates: Arc::default(),
            session_episodes: Arc::default(),
            audits,
            report_order,
        };
        let sessions = create_sessions(&config, surface, &lease_service)?;
        let workers = match &config.process_token {
            None => spawn_workers(&config, &lease_service, signals.clone(), ready_sender, &sessions, remote)?,
            Some(_) => JoinSet::new(),
        };
        let access_control = create_access_control(&config, &lease_service, address);
        if config.process_token.is_none()
            && let Err(error) = lock.publish_url(&server_url(address, tls.as_deref()))
        {
            tracing::warn!(%error, "The lock file has no URL: programs on this machine need --url.");
        }
        let stopping: Arc<AtomicBool> = Arc::default();
        let checkpointer = tokio::spawn(workers::checkpoint::run(
            open_maintenance(&config.db).await?,
            Arc::clone(&lock),
            stopped.clone(),
        ));
        let state =
            create_state(config, lease_service, shards, &sessions, &signals, stopped.clone(), &stopping);
        let routes = http::router(state, Arc::new(access_control), surface);
        let server = tokio::spawn(http::serve(listener, routes, tls.clone(), stopped));
        Ok(Self {
            address,
            tls,
            stopping,
            stop,
            sessions,
            server,
            workers,
            checkpointer,
            writer,
            writer_task,
            readers,
            lock,
        })
    }

    /// Returns the URL of the server.
    #[must_use]
    pub fn url(&self) -> String {
        server_url(self.address, self.tls.as_deref())
    }

    /// Returns the TLS settings, whose files can be read again; `None` if connections are not encrypted.
    #[must_use]
    pub fn tls(&self) -> Option<Arc<ServerTls>> {
        self.tls.clone()
    }

    /// Returns the address that the server listens on.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Deletes the data of all deleted runs. A server has a worker for this; a service of one process has none.
    ///
    /// # Errors
    /// Returns [`ServiceError`] if the database cannot be written. The next server continues.
    pub async fn finish_deletions(&self) -> Result<(), ServiceError> {
        workers::delete_runs::delete_pending(&self.writer).await
    }

    /// Stops the service: rejects new requests, finishes running ones, ends sessions and workers, stores snapshots, and
    /// closes the database.
    pub async fn stop(mut self) {
        self.stopping.store(true, Ordering::SeqCst);
        self.stop.send_replace(true);
        self.sessions.shut_down().await;
        if tokio::time::timeout(SHUTDOWN_TIMEOUT, &mut self.server).await.is_err() {
            tracing::warn!("Some requests did not end in time and were cut off.");
            self.server.abort();
            let _ = self.server.await;
        }
        // Workers have no state outside the database: aborted work is repeated after the next start.
        self.workers.shutdown().await;
        if let Err(error) = self.checkpointer.await {
            tracing::error!(%error, "The checkpoint worker failed.");
        }
        // The writer ends when its last handle is dropped.
        drop((self.sessions, self.writer));
        match tokio::time::timeout(SHUTDOWN_TIMEOUT, self.writer_task).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => tracing::error!(%error, "The writer failed."),
            Err(_) => {
                tracing::warn!("The writer did not end in time; all acknowledged changes are stored.");
            }
        }
        self.readers.close().await;
        drop(self.lock);
    }

    /// Waits until the writer fails, after which nothing can be stored any more: the process should exit.
    pub async fn writer_failed(&mut self) {
        if let Err(error) = (&mut self.writer_task).await {
            tracing::error!(%error, "The writer failed.");
        }
    }
}

/// Returns the URL of a server at an address.
fn server_url(address: SocketAddr, tls: Option<&ServerTls>) -> String {
    let scheme = if tls.is_some() { "https" } else { "http" };
    format!("{scheme}://{address}")
}

/// Creates the manager of sessions. A server that shows only OpenEnv's routes has no sessions for runs.
fn create_sessions(
    config: &Config,
    surface: ApiSurface,
    lease_service: &LeaseService,
) -> Result<Arc<SessionManager>, StartError> {
    let allow_runs = config.sessions.allow_runs && surface == ApiSurface::Whole;
    let limits = SessionLimits { allow_runs, ..config.sessions };
    let threads = threads::pool("sessions", 0, ThreadPriority::Normal).map_err(StartError::Threads)?;
    Ok(Arc::new(SessionManager::new(limits, lease_service.clone(), Arc::clone(&config.judges), threads)))
}

/// Creates the state of the request handlers.
fn create_state(
    config: Config,
    lease_service: LeaseService,
    shards: Arc<Shards>,
    sessions: &Arc<SessionManager>,
    signals: &WorkerSignals,
    stopped: watch::Receiver<bool>,
    stopping: &Arc<AtomicBool>,
) -> AppState {
    AppState {
        writer: lease_service.writer.clone(),
        readers: lease_service.readers.clone(),
        clock: config.clock,
        client_limits: config.client_limits,
        lease_service,
        shards,
        trainers: Arc::default(),
        started: Instant::now(),
        folder: folder_of(&config.db),
        sessions: Arc::clone(sessions),
        openenv_public: config.openenv_public,
        episode_boards: Arc::default(),
        body_limit: BodyLimit::new(MAX_LARGE_BODIES),
        events: Arc::clone(&signals.events),
        listeners: Arc::new(Quota::new(MAX_LISTENERS, MAX_LISTENERS_PER_CLIENT)),
        feed_answers: Arc::new(Quota::new(MAX_FEED_ANSWERS, MAX_FEED_ANSWERS_PER_CLIENT)),
        metrics_rate: Arc::new(RateLimit::new(METRICS_REQUESTS_PER_SECOND)),
        concurrency: ConcurrencyLimits::default(),
        designers: config.designers,
        judges: config.judges,
        endpoint: config.endpoint,
        policy_folder: config.policy_folder,
        has_nats: config.remote_workers.is_some(),
        long_polls: LongPollLimit::new(signals.feed.subscribe(), stopped),
        alert_rules: config.alerts.rules,
        has_alert_webhook: config.alerts.webhook.is_some(),
        readiness: http::ReadinessProbe::default(),
        stopping: Arc::clone(stopping),
    }
}

/// Creates the check of clients and their permissions.
fn create_access_control(
    config: &Config,
    lease_service: &LeaseService,
    bind: SocketAddr,
) -> http::AccessControl {
    http::AccessControl::new(http::AccessConfig {
        readers: lease_service.readers.clone(),
        writer: lease_service.writer.clone(),
        clock: config.clock.clone(),
        bind,
        openenv_public: config.openenv_public,
        limits: config.client_limits,
        process_token: config.process_token.as_ref().map(Token::hash),
    })
}

/// Spawns all workers. `ready` signals that scenarios were prepared.
fn spawn_workers(
    config: &Config,
    lease_service: &LeaseService,
    signals: WorkerSignals,
    ready: watch::Sender<u64>,
    sessions: &Arc<SessionManager>,
    remote: Option<RemoteQueue>,
) -> Result<JoinSet<()>, StartError> {
    let workers = WorkerConfig {
        clock: config.clock.clone(),
        lease_service: lease_service.clone(),
        signals,
        ready,
        sessions: Arc::clone(sessions),
        designers: Arc::clone(&config.designers),
        endpoint: config.endpoint.clone(),
        policy_folder: config.policy_folder.clone(),
        archived_retention: config.archived_retention,
        alerts: config.alerts.clone(),
        folder: folder_of(&config.db),
        remote,
        feeds: service_queue::feed_server(config),
    };
    workers.spawn().map_err(StartError::Threads)
}

/// Returns the folder of a file.
fn folder_of(file: &Path) -> PathBuf {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}
