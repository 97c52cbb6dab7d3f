//! Workers on NATS beside the server of a crash test. They and the NATS server are killed, too.

use anyhow::Context;

use crate::ApiClient;
use crate::nats_server::NatsServer;
use crate::worker_cluster::{WorkerProcess, nats_options};

/// Beginning of the metrics that count the jobs of workers by kind.
const KIND_METRIC: &str = "sparring_remote_kind_jobs_total{kind=\"";
/// Jobs of the workers: all kinds that need no configuration.
const JOBS: &str = "prepare,audit,critique,design,rollout";
/// NATS is killed in one of so many rounds, and is away until the next one.
const NATS_ROUNDS: u32 = 3;

/// Number of killed processes beside the server, and of jobs that workers did.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RemoteExits {
    /// Number of workers that were killed.
    pub(super) workers: u32,
    /// Number of NATS servers that were killed.
    pub(super) nats: u32,
    /// Number of jobs whose results came from workers, as the servers said before they were killed.
    pub(super) jobs: u64,
    /// Number of these jobs that designed layouts.
    pub(super) designs: u64,
    /// Number of these jobs that rolled out policies.
    pub(super) rollouts: u64,
}

/// Workers of a crash test with the NATS server; none if the plan has no workers.
pub(super) struct RandomWorkers {
    nats: Option<NatsServer>,
    workers: Vec<WorkerProcess>,
    is_away: bool,
    pub(super) exits: RemoteExits,
}

impl RandomWorkers {
    /// Starts NATS and the workers.
    ///
    /// # Errors
    /// Returns an error if the package index has no NATS server.
    pub(super) fn start(count: usize) -> anyhow::Result<Self> {
        let nats = match count {
            0 => None,
            _ => Some(NatsServer::start().context("the package index has no NATS server")?),
        };
        let workers = nats.iter().flat_map(|nats| (0..count).map(move |number| worker(nats, number as u32)));
        let workers = workers.collect();
        Ok(Self { nats, workers, is_away: false, exits: RemoteExits::default() })
    }

    /// Options of the server.
    pub(super) fn server_options(&self) -> Vec<String> {
        self.nats.as_ref().map_or_else(Vec::new, |nats| nats_options(&nats.url()))
    }

    /// Adds the jobs that workers did for a server, before it is killed. A server that does not answer has done none.
    pub(super) async fn count_jobs(&mut self, api: &ApiClient) {
        if self.nats.is_none() {
            return;
        }
        let Ok(metrics) = api.try_request("GET", "/metrics", "application/json", "").await else { return };
        for line in metrics.body.as_str().unwrap_or_default().lines() {
            let Some((kind, count)) = line.strip_prefix(KIND_METRIC).and_then(|rest| rest.split_once("\"} "))
            else {
                continue;
            };
            let count = count.parse::<u64>().unwrap_or(0);
            self.exits.jobs += count;
            self.exits.designs += if kind.starts_with("design") { count } else { 0 };
            self.exits.rollouts += if kind.starts_with("rollout") { count } else { 0 };
        }
    }

    /// Kills a worker and starts another one; kills NATS in some rounds, and starts it in the round after.
    pub(super) fn kill_some(&mut self, round: u32) {
        let Some(nats) = &mut self.nats else { return };
        if self.is_away {
            nats.resume();
            self.is_away = false;
        } else if round % NATS_ROUNDS == 1 {
            nats.kill();
            self.is_away = true;
            self.exits.nats += 1;
        }
        let position = round as usize % self.workers.len();
        self.workers[position] = worker(nats, round);
        self.exits.workers += 1;
    }

    /// Ends the faults: NATS is there again.
    pub(super) fn recover(&mut self) {
        if let Some(nats) = self.nats.as_mut().filter(|_| self.is_away) {
            nats.resume();
            self.is_away = false;
        }
    }
}

/// Starts a worker, whose host has a number.
fn worker(nats: &NatsServer, number: u32) -> WorkerProcess {
    let (url, host) = (nats.url(), format!("host{number}"));
    WorkerProcess::start_with_options(&["--nats", &url, "--host", &host, "--jobs", JOBS])
}
