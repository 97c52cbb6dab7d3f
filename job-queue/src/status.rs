//! State of a queue and its workers, for operators.

use std::collections::BTreeSet;
use std::time::Duration;

use env_core::ScenarioId;
use jobs::JobKind;

/// State of a queue.
#[derive(Debug, Clone, Default)]
pub struct QueueStatus {
    /// True if jobs can go to workers on other machines.
    pub is_distributed: bool,
    /// Why the server does all jobs itself although workers are configured; `None` if workers do jobs.
    pub degraded: Option<String>,
    /// Number of jobs that were sent to workers and have no result yet.
    pub waiting: usize,
    /// Known workers, by id.
    pub workers: Vec<WorkerStatus>,
    /// Counters since the start of the server.
    pub counters: QueueCounters,
}

impl QueueStatus {
    /// Language models of active workers that roll out `chat`, each once.
    #[must_use]
    pub fn chat_models(&self) -> Vec<String> {
        let active = self.workers.iter().filter(|worker| worker.state == WorkerState::Active);
        let rolls_out = active.filter(|worker| worker.kinds.contains(&JobKind::RolloutChat));
        let models: BTreeSet<&String> = rolls_out.filter_map(|worker| worker.chat_model.as_ref()).collect();
        models.into_iter().cloned().collect()
    }

    /// True if an active worker takes jobs of a kind.
    #[must_use]
    pub fn is_served(&self, kind: JobKind) -> bool {
        let mut active = self.workers.iter().filter(|worker| worker.state == WorkerState::Active);
        active.any(|worker| worker.kinds.contains(&kind))
    }
}

/// Counters of a queue since the start of the server.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct QueueCounters {
    /// Jobs that the server sent to workers.
    pub sent: u64,
    /// Jobs whose results came from workers.
    pub done_remotely: u64,
    /// The same by kind, in the order of [`JobKind::ALL`].
    pub done_by_kind: [u64; JobKind::ALL.len()],
    /// Jobs that the server did itself.
    pub done_locally: u64,
    /// Jobs that the server took back from the queue and did itself.
    pub taken_back: u64,
    /// Results that were ignored: late, repeated, or of an expelled worker.
    pub ignored_results: u64,
    /// Items that the server recomputed to verify workers.
    pub verified_items: u64,
    /// Bytes of jobs that were sent.
    pub bytes_sent: u64,
    /// Bytes of results that were received.
    pub bytes_received: u64,
}

impl QueueCounters {
    /// Counts a job whose result came from a worker.
    pub(crate) fn count_remote(&mut self, kind: JobKind, bytes: u64) {
        self.done_remotely += 1;
        self.bytes_received += bytes;
        if let Some(count) = self.done_by_kind.get_mut(kind as usize) {
            *count += 1;
        }
    }
}

/// State of a worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WorkerState {
    /// The worker takes jobs.
    Active,
    /// The worker has sent no heartbeat for some seconds.
    Stalled,
    /// The worker may not take jobs, because it computes other worlds.
    Refused,
    /// The worker may not take jobs, because a result of it was wrong.
    Expelled,
}

impl WorkerState {
    /// The word for the API and metrics.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Active => "active",
            Self::Stalled => "stalled",
            Self::Refused => "refused",
            Self::Expelled => "expelled",
        }
    }
}

/// A worker as the server knows it.
#[derive(Debug, Clone)]
pub struct WorkerStatus {
    /// Id of the worker process.
    pub id: String,
    /// Name of the worker's host, or the name that its operator gave it.
    pub host: String,
    /// Version of the program.
    pub version: String,
    /// World version of the program.
    pub world: String,
    /// Kinds of jobs that the worker takes.
    pub kinds: Vec<JobKind>,
    /// Number of jobs that it does at once.
    pub concurrency: u32,
    /// Name of its language model for the policy `chat`, if it has one.
    pub chat_model: Option<String>,
    /// Number of jobs that it does now.
    pub active: u32,
    /// State of the worker.
    pub state: WorkerState,
    /// Why the worker was refused or expelled.
    pub reason: Option<String>,
    /// Jobs whose results the server accepted.
    pub jobs: u64,
    /// Jobs that failed, or whose results were wrong.
    pub errors: u64,
    /// Accepted jobs a second, over about ten seconds.
    pub jobs_per_s: f64,
    /// Items that the server recomputed, and that were equal.
    pub verified: u64,
    /// Time since the last heartbeat.
    pub last_seen: Duration,
}

/// Change of the workers or the queue, for logs and events.
#[derive(Debug, Clone)]
pub enum QueueNotice {
    /// A worker takes jobs now.
    Joined(WorkerIdentity),
    /// A worker sends no heartbeats.
    Stalled(WorkerIdentity),
    /// A worker has ended.
    Left(WorkerIdentity),
    /// A worker was refused, for this reason.
    Refused(WorkerIdentity, String),
    /// A worker was expelled, for this reason.
    Expelled(WorkerIdentity, String),
    /// Results of an expelled worker were recomputed.
    Recomputed(Recomputation),
    /// The server does all jobs itself, for this reason.
    Degraded(String),
    /// Workers do jobs again.
    Restored,
}

/// Names of a worker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WorkerIdentity {
    /// Id of the worker process.
    pub id: String,
    /// Name of the worker's host, or the name that its operator gave it.
    pub host: String,
}

/// Results of an expelled worker that the server recomputed.
#[derive(Debug, Clone)]
pub struct Recomputation {
    /// The worker that was expelled.
    pub worker: WorkerIdentity,
    /// Number of results that were recomputed.
    pub items: usize,
    /// The results of jobs that were wrong.
    pub wrong: Vec<WrongResult>,
    /// The layouts that were wrong.
    pub wrong_layouts: Vec<WrongLayout>,
}

impl Recomputation {
    /// Creates a recomputation without results.
    pub(crate) const fn new(worker: WorkerIdentity) -> Self {
        Self { worker, items: 0, wrong: Vec::new(), wrong_layouts: Vec::new() }
    }
}

/// A layout of a worker that the gate of the server judges otherwise.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WrongLayout {
    /// Id of the run that it was designed for.
    pub run: String,
    /// Id of its task.
    pub task: String,
    /// Scenario of the layout.
    pub scenario: ScenarioId,
}

/// A result of a worker that the server's own result contradicts.
#[derive(Debug, Clone)]
pub struct WrongResult {
    /// The job, with the one item.
    pub job: jobs::JobPayload,
    /// Result of the server.
    pub computed: jobs::JobOutput,
}
