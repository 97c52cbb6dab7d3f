//! Workers on other machines.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Workers of the server, and what they do.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RemoteWorkerList {
    /// True if the server was started with `--nats`, so that workers on other machines can do its jobs.
    pub distributed: bool,
    /// Why the server does all jobs itself although it was started with `--nats`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub degraded: Option<String>,
    /// Number of jobs that were sent to workers and have no result yet.
    #[schema(minimum = 0)]
    pub waiting: usize,
    /// Workers by id. A worker that ended is not in the list.
    pub workers: Vec<RemoteWorker>,
    /// Counters since the start of the server.
    pub counters: JobCounters,
}

/// Worker on another machine.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RemoteWorker {
    /// Id of the worker's process.
    pub id: String,
    /// Name of the worker's host, or the name that its operator gave it.
    pub host: String,
    /// Version of the worker's program.
    pub version: String,
    /// Version of the worlds that the worker computes. It must be that of the server.
    pub world: String,
    /// State of the worker.
    pub state: RemoteWorkerState,
    /// Why the worker was refused or expelled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Kinds of jobs that the worker takes: `prepare`, `audit`, `critique`, `design_procedural`, `design_llm`, `rollout_built_in`,
    /// `rollout_file`, `rollout_chat`.
    pub kinds: Vec<String>,
    /// Number of jobs that the worker does at once.
    pub concurrency: u32,
    /// Number of jobs that the worker does now.
    pub active_jobs: u32,
    /// Number of jobs whose results the server accepted.
    #[schema(minimum = 0)]
    pub jobs: u64,
    /// Accepted jobs a second, over about ten seconds.
    pub jobs_per_s: f64,
    /// Number of jobs that failed, or whose results were wrong.
    #[schema(minimum = 0)]
    pub errors: u64,
    /// Number of results that the server recomputed, and that were equal.
    #[schema(minimum = 0)]
    pub verified: u64,
    /// Time since the worker's last heartbeat, in seconds.
    pub last_seen_s: f64,
}

/// State of a worker on another machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RemoteWorkerState {
    /// The worker takes jobs.
    Active,
    /// The worker has sent no heartbeat for four seconds or more.
    Stalled,
    /// The worker computes other worlds, and gets no jobs.
    Refused,
    /// A result of the worker was wrong, and it gets no jobs.
    Expelled,
}

/// Counters of jobs since the start of the server.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize, ToSchema)]
pub struct JobCounters {
    /// Number of jobs that the server sent to workers.
    #[schema(minimum = 0)]
    pub sent: u64,
    /// Number of jobs whose results came from workers.
    #[schema(minimum = 0)]
    pub done_remotely: u64,
    /// Number of jobs that the server did itself; 0 without `--nats`.
    #[schema(minimum = 0)]
    pub done_locally: u64,
    /// Number of jobs that were sent, and that the server then did itself.
    #[schema(minimum = 0)]
    pub taken_back: u64,
    /// Number of results that were ignored: late, repeated, or of an expelled worker.
    #[schema(minimum = 0)]
    pub ignored_results: u64,
    /// Number of results that the server recomputed to verify workers.
    #[schema(minimum = 0)]
    pub verified: u64,
    /// Bytes of the jobs that were sent.
    #[schema(minimum = 0)]
    pub bytes_sent: u64,
    /// Bytes of the results that were received.
    #[schema(minimum = 0)]
    pub bytes_received: u64,
}
