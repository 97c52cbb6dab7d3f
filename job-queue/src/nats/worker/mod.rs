//! Worker side: takes jobs from NATS, does them on threads of this process, and sends the results back.
//!
//! A worker takes jobs only after a server has welcomed it. It ends with an error if a server refuses or expels it, and connects again
//! by itself if NATS is away. `takers` has the loops that take jobs, `job_run` does one job, `design_run` a design, `rollout_run` a
//! rollout, and `run_versions` knows which rollouts are not wanted any more.

mod design_run;
mod job_run;
mod rollout_run;
mod run_versions;
mod takers;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use async_nats::{Client, jetstream};
use futures_util::StreamExt;
use jobs::JobKind;
use jobs::envelope::JobId;
use jobs::prepare::unsolvable::UnsolvableParams;
use jobs::world_version::world_version;
use parking_lot::Mutex;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use rollout::PolicySources;
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinSet;

pub use self::design_run::WorkerDesigners;
use self::run_versions::RunVersions;
use super::connection::{Connection, NatsConfig, NatsError};
use super::membership::{self, ControlMessage, Heartbeat};
use super::names::subject_word;

/// Interval between two heartbeats.
const HEARTBEAT_INTERVAL: Duration = Duration::from_secs(1);
/// Pause before the next attempt to connect.
const RETRY_PAUSE: Duration = Duration::from_secs(1);
/// Heartbeats without an answer after which the worker logs that it waits.
const SILENT_HEARTBEATS: u32 = 10;
/// Nice value of threads that do jobs: other programs of the machine come first.
const JOB_NICE: i32 = 5;
/// Nice value of threads that design: replays come first.
const BACKGROUND_NICE: i32 = 19;
/// Largest number of characters of a model's name in a heartbeat.
const MAX_MODEL_CHARS: usize = 200;
/// Time that running jobs have to finish when the worker stops.
const STOP_TIMEOUT: Duration = Duration::from_secs(10);

/// Configuration of a worker.
#[derive(Debug, Clone)]
pub struct WorkerConfig {
    /// How to reach NATS.
    pub nats: NatsConfig,
    /// Name of the host, by which operators find the worker.
    pub host: String,
    /// Kinds of jobs to take.
    pub kinds: BTreeSet<JobKind>,
    /// Number of jobs to do at once.
    pub concurrency: usize,
    /// Policies that it can roll out, besides the built-in ones.
    pub policies: PolicySources,
    /// Designers of layouts, besides the procedural one.
    pub designers: WorkerDesigners,
}

impl WorkerConfig {
    /// Number of calls of the language model that rollouts make at once; 0 without a model.
    fn chat_calls(&self) -> usize {
        self.policies.endpoint.as_ref().map_or(0, |endpoint| endpoint.llm.config().concurrency)
    }

    /// Name of the language model of rollouts, shortened.
    fn chat_model(&self) -> Option<String> {
        let endpoint = self.policies.endpoint.as_ref()?;
        Some(endpoint.llm.config().model.chars().take(MAX_MODEL_CHARS).collect())
    }
}

/// Reason why a worker ends.
#[derive(Debug, thiserror::Error)]
pub enum WorkerError {
    /// A server refuses the worker, for example because it computes other worlds.
    #[error("the server refused this worker: {0}")]
    Refused(String),
    /// A server expelled the worker.
    #[error(
        "the server expelled this worker: {0}; check the memory and the processor of this machine, and that it runs the same version as the server"
    )]
    Expelled(String),
    /// NATS rejects the user of the first connection or its TLS, or does not permit what the worker needs.
    #[error(transparent)]
    Nats(NatsError),
    /// The system cannot create the threads.
    #[error("the threads of the worker cannot be started: {0}")]
    Threads(#[from] ThreadPoolBuildError),
}

/// A worker process, across connections.
#[derive(Debug)]
pub(super) struct WorkerProcess {
    config: WorkerConfig,
    /// Id of the process: the host's name with random digits.
    id: String,
    world: &'static str,
    pool: ThreadPool,
    unsolvable: UnsolvableParams,
    /// Jobs that the worker holds.
    active: Mutex<BTreeSet<JobId>>,
    /// One permit for each job that may run.
    permits: Arc<Semaphore>,
    /// One permit for each call of the language model that acts.
    chat_calls: Arc<Semaphore>,
    /// One permit: the procedural designer computes, as it does in a server.
    procedural_designs: Arc<Semaphore>,
    /// One permit for each request to the language model that designs.
    llm_designs: Arc<Semaphore>,
    run_versions: RunVersions,
}

impl WorkerProcess {
    /// Permits of a kind of jobs that need no thread of the pool. Such a job is taken once a permit is free, and is left to other
    /// workers until then.
    fn own_permits(&self, kind: JobKind) -> Option<Arc<Semaphore>> {
        match kind {
            JobKind::RolloutChat => Some(Arc::clone(&self.chat_calls)),
            JobKind::DesignProcedural => Some(Arc::clone(&self.procedural_designs)),
            JobKind::DesignLlm => Some(Arc::clone(&self.llm_designs)),
            JobKind::Prepare
            | JobKind::Audit
            | JobKind::Critique
            | JobKind::RolloutBuiltIn
            | JobKind::RolloutFile => None,
        }
    }
}

/// Runs a worker until `stop` becomes true.
///
/// # Errors
/// Returns [`WorkerError`] if NATS rejects the first connection or does not permit the jobs, if a server refuses or expels the worker,
/// or if the threads cannot be started. While NATS is away, or no server answers, the worker waits.
pub async fn run(config: WorkerConfig, mut stop: watch::Receiver<bool>) -> Result<(), WorkerError> {
    tracing::info!(nats = %config.nats.url, "The worker computes the version of its worlds, and then connects.");
    let world = tokio::select! {
        world = tokio::task::spawn_blocking(world_version) => world.unwrap_or_default(),
        () = stopped(&mut stop) => return Ok(()),
    };
    run_in_world(config, stop, world).await
}

/// Runs a worker with a world version.
pub(super) async fn run_in_world(
    config: WorkerConfig,
    mut stop: watch::Receiver<bool>,
    world: &'static str,
) -> Result<(), WorkerError> {
    let concurrency = config.concurrency.max(1);
    let pool = ThreadPoolBuilder::new()
        .num_threads(concurrency)
        .thread_name(|i| format!("job-{i}"))
        .start_handler(|_| lower_priority(JOB_NICE))
        .build()?;
    let id = format!("{}-{:06x}", subject_word(&config.host), rand::random::<u32>() & 0x00ff_ffff);
    let permits = Arc::new(Semaphore::new(concurrency));
    let state = Arc::new(WorkerProcess {
        id,
        world,
        pool,
        unsolvable: UnsolvableParams::default(),
        active: Mutex::default(),
        permits,
        chat_calls: Arc::new(Semaphore::new(config.chat_calls())),
        procedural_designs: Arc::new(Semaphore::new(1)),
        llm_designs: Arc::new(Semaphore::new(config.designers.llm_designs())),
        run_versions: RunVersions::default(),
        config,
    });
    tracing::info!(id = state.id, world, concurrency, "The worker started.");
    let mut link = LinkState::default();
    loop {
        match serve(&state, &mut stop, &mut link).await {
            Ok(()) => return Ok(()),
            Err(SessionEnd::Rejected(error)) => return Err(error),
            // Credentials that were valid may become valid again. Missing permissions stay missing.
            Err(SessionEnd::Interrupted(error))
                if matches!(error, NatsError::Denied(_)) || !link.was_open && !error.passes() =>
            {
                return Err(WorkerError::Nats(error));
            }
            Err(SessionEnd::Interrupted(error)) => link.log(&error),
        }
        tokio::select! {
            () = tokio::time::sleep(RETRY_PAUSE) => {}
            () = stopped(&mut stop) => return Ok(()),
        }
    }
}

/// Connection to NATS, across attempts.
#[derive(Debug, Default)]
struct LinkState {
    /// True if a connection was open before.
    was_open: bool,
    /// Reason of the interruption that the log has; `None` while the connection is open.
    logged: Option<NatsError>,
}

impl LinkState {
    /// Notes that a connection is open.
    fn note_open(&mut self) {
        *self = Self { was_open: true, logged: None };
    }

    /// Logs why the worker connects again, unless the log has it: attempts follow each other.
    fn log(&mut self, error: &NatsError) {
        if self.logged.as_ref() != Some(error) {
            let problem = if error.passes() { "is away" } else { "cannot be used" };
            tracing::warn!(error = %error, "NATS {problem}; the worker connects again.");
            self.logged = Some(error.clone());
        }
    }
}

/// Reason why a connection ended before the worker was stopped.
enum SessionEnd {
    /// The worker may not go on.
    Rejected(WorkerError),
    /// The worker connects again.
    Interrupted(NatsError),
}

impl From<NatsError> for SessionEnd {
    fn from(error: NatsError) -> Self {
        Self::Interrupted(error)
    }
}

/// Serves one connection until the worker is stopped.
async fn serve(
    state: &Arc<WorkerProcess>,
    stop: &mut watch::Receiver<bool>,
    link: &mut LinkState,
) -> Result<(), SessionEnd> {
    let connection = tokio::select! {
        connection = Connection::open(&state.config.nats, "sparring worker") => connection?,
        () = stopped(stop) => return Ok(()),
    };
    link.note_open();
    let client = connection.client.clone();
    let cluster = &state.config.nats.cluster;
    let control = client.subscribe(cluster.control(&state.id)).await;
    let mut control = control.map_err(|error| NatsError::new("answers cannot be read", error))?;
    let context = jetstream::new(client.clone());
    let mut end = std::pin::pin!(connection.end());
    let mut takers = JoinSet::new();
    let mut ticks = tokio::time::interval(HEARTBEAT_INTERVAL);
    let mut silent = 0;
    loop {
        tokio::select! {
            error = &mut end => return Err(end_session(state, &client, error).await),
            message = control.next() => {
                let Some(message) = message else { return Err(NatsError::Failed("the answers ended".to_owned()).into()) };
                match membership::read::<ControlMessage>(&message.payload) {
                    Some(ControlMessage::Welcome { server }) => {
                        silent = 0;
                        if takers.is_empty() {
                            tracing::info!(server, cluster = %cluster, "The worker takes jobs.");
                            takers::spawn(state, &context, &mut takers);
                        }
                    }
                    Some(ControlMessage::Refused { reason }) => {
                        return Err(SessionEnd::Rejected(WorkerError::Refused(reason)));
                    }
                    Some(ControlMessage::Expelled { reason }) => {
                        return Err(SessionEnd::Rejected(WorkerError::Expelled(reason)));
                    }
                    None => tracing::debug!("An answer of a server cannot be read and is ignored."),
                }
            }
            _ = ticks.tick() => {
                let phase = if takers.is_empty() { WorkerPhase::Waiting } else { WorkerPhase::Working };
                send_heartbeat(state, &client, phase).await?;
                silent += 1;
                if takers.is_empty() && silent % SILENT_HEARTBEATS == 0 {
                    tracing::warn!(cluster = %cluster, "No server answers yet; the worker waits.");
                }
            }
            Some(ended) = takers.join_next() => {
                // The server creates the consumers; they are missing for a moment after NATS lost its data.
                let reason = ended.map_or_else(|error| error.to_string(), |error| error.to_string());
                return Err(NatsError::Failed(reason).into());
            }
            () = stopped(stop) => {
                takers.shutdown().await;
                finish_jobs(state).await;
                leave(state, &client).await;
                return Ok(());
            }
        }
    }
}

/// Ends a session. A worker without permissions leaves.
async fn end_session(state: &WorkerProcess, client: &Client, error: NatsError) -> SessionEnd {
    if matches!(error, NatsError::Denied(_)) {
        leave(state, client).await;
    }
    error.into()
}

/// Announces that the worker ends. A server that misses it notices the missing heartbeats.
async fn leave(state: &WorkerProcess, client: &Client) {
    let _ = send_heartbeat(state, client, WorkerPhase::Leaving).await;
    let _ = client.flush().await;
}

/// Waits until the worker is to stop.
async fn stopped(stop: &mut watch::Receiver<bool>) {
    // An error means that the sender is gone, which stops the worker too.
    let _ = stop.wait_for(|stop| *stop).await;
}

/// Waits until the running jobs are done, at most for [`STOP_TIMEOUT`]. Unfinished ones are delivered to other workers.
async fn finish_jobs(state: &WorkerProcess) {
    let finished = async {
        while !state.active.lock().is_empty() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    let _ = tokio::time::timeout(STOP_TIMEOUT, finished).await;
}

/// Phase of a worker's connection, which its heartbeats tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum WorkerPhase {
    /// No server has welcomed the worker yet.
    Waiting,
    /// The worker takes jobs.
    Working,
    /// The worker ends after its running jobs.
    Leaving,
}

async fn send_heartbeat(state: &WorkerProcess, client: &Client, phase: WorkerPhase) -> Result<(), NatsError> {
    let WorkerProcess { config, id, world, active, .. } = state;
    let heartbeat = Heartbeat {
        id: id.clone(),
        host: config.host.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        world: (*world).to_owned(),
        kinds: config.kinds.iter().map(ToString::to_string).collect(),
        concurrency: u32::try_from(config.concurrency.max(1)).unwrap_or(u32::MAX),
        chat_calls: u32::try_from(config.chat_calls()).unwrap_or(u32::MAX),
        chat_model: config.chat_model(),
        llm_designs: u32::try_from(config.designers.llm_designs()).unwrap_or(u32::MAX),
        active: active.lock().iter().copied().collect(),
        is_waiting: phase == WorkerPhase::Waiting,
        is_leaving: phase == WorkerPhase::Leaving,
    };
    let subject = config.nats.cluster.heartbeats(id);
    let sent = client.publish(subject, membership::write(&heartbeat).into()).await;
    sent.map_err(|error| NatsError::new("a heartbeat cannot be sent", error))
}

/// Lowers the priority of the current thread to a nice value.
fn lower_priority(nice: i32) {
    #[cfg(not(target_os = "linux"))]
    let _ = nice;
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(nice) {
        tracing::debug!(error = %error, "The priority of a thread could not be lowered.");
    }
}
