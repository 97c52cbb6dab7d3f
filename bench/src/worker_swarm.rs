//! A server with a thousand idle workers and with two hundred busy ones, simulated by one process on loopback.

use std::io::Write;
use std::time::Duration;

use anyhow::Context;
use job_queue::nats::worker::{WorkerConfig, run as run_worker};
use job_queue::nats::{NatsConfig, NatsUrl};
use jobs::JobKind;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde_json::{Value, json};
use system_tests::ApiClient;
use system_tests::nats_server::NatsServer;
use system_tests::worker_cluster::WorkerCluster;
use tokio::sync::watch;
use tokio::task::JoinSet;

use crate::Row;
use crate::report_episodes::report_episodes;
use crate::results::{LeaseLatency, measure_leases};
use crate::sockets::process::{cpu_s, resident_bytes};

/// Number of idle workers.
const IDLE: usize = 1000;
/// Number of busy workers.
const BUSY: usize = 200;
/// Episodes that are reported while leases are measured.
const EPISODES: u64 = 20_000;
/// Time over which idle workers are observed.
const IDLE_TIME: Duration = Duration::from_secs(20);
/// Files that the workers of this process open: one connection each, and some of the runtime.
const OPEN_FILES: u64 = 8192;
/// Largest ratio of the 99th percentile of leases with busy workers to that without: workers share the cores of this machine.
const GOAL_LATENCY: f64 = 3.0;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let limit = getrlimit(Resource::Nofile);
    let files = limit.maximum.map_or(OPEN_FILES, |maximum| maximum.min(OPEN_FILES));
    setrlimit(Resource::Nofile, Rlimit { current: Some(files), maximum: limit.maximum })?;
    tokio::runtime::Runtime::new()?.block_on(run())
}

async fn run() -> anyhow::Result<Vec<Row>> {
    let nats = NatsServer::start().context("the package index has no NATS server")?;
    let url: NatsUrl = nats.url().parse()?;
    let cluster = WorkerCluster::start(Some(nats), 0).await;
    let (api, pid) = (cluster.api(), cluster.server().pid());
    let settings = json!({"id": "bench", "seed": 1, "group_size": 8, "strategy": "ladder", "design": {"designer": "off"},
                          "tasks": ["kessler/survival"]});
    let created = api.post("/v1/runs", settings).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    let alone = lease_latency(&api).await?;
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let before = mib(resident_bytes(pid)?);

    let mut idle = Swarm::start(&url, IDLE);
    cluster.wait_for_workers(IDLE).await;
    let cpu = cpu_s(pid)?;
    tokio::time::sleep(IDLE_TIME).await;
    let cores = (cpu_s(pid)? - cpu) / IDLE_TIME.as_secs_f64();
    let with_idle = mib(resident_bytes(pid)?);
    writeln!(std::io::stderr(), "{IDLE} idle workers: {with_idle:.0} MiB, {cores:.3} cores")?;
    idle.keep(BUSY);
    let counters = counters(&api).await;
    let busy = lease_latency(&api).await?;
    let count =
        |after: &Value, name: &str| after[name].as_u64().unwrap_or(0) - counters[name].as_u64().unwrap_or(0);
    let after = self::counters(&api).await;
    Ok(vec![
        Row::plain(
            format!("memory of the server with {IDLE} idle workers, and before"),
            format!("{with_idle:.0}, {before:.0} MiB"),
        ),
        Row::plain(format!("cores of the server that {IDLE} idle workers take"), format!("{cores:.3}")),
        Row {
            label: format!("p99 of leases beside results: {BUSY} busy workers, none"),
            measured: format!("{:.1}, {:.1} ms", busy.p99_ms, alone.p99_ms),
            goal: format!("ratio ≤ {GOAL_LATENCY}"),
            ratio: Some(GOAL_LATENCY * alone.p99_ms / busy.p99_ms),
        },
        Row::plain(
            format!("jobs of {BUSY} busy workers: done, taken back, results ignored"),
            ["done_remotely", "taken_back", "ignored_results"]
                .map(|name| count(&after, name).to_string())
                .join(", "),
        ),
    ])
}

/// Counters of jobs since the start of the server.
async fn counters(api: &ApiClient) -> Value {
    api.get("/v1/workers").await.body["counters"].take()
}

/// Measures leases while trainers report results.
async fn lease_latency(api: &ApiClient) -> anyhow::Result<LeaseLatency> {
    let (done, stop) = tokio::sync::oneshot::channel::<()>();
    let leasing = tokio::spawn(measure_leases(api.clone(), stop));
    report_episodes(api, "bench", EPISODES).await?;
    drop(done);
    Ok(leasing.await?)
}

/// Workers of this process.
struct Swarm {
    workers: JoinSet<()>,
    stops: Vec<watch::Sender<bool>>,
}

impl Swarm {
    fn start(url: &NatsUrl, count: usize) -> Self {
        let mut swarm = Self { workers: JoinSet::new(), stops: Vec::new() };
        for number in 0..count {
            let nats = NatsConfig {
                url: url.clone(),
                credentials: None,
                authorities: None,
                cluster: Default::default(),
            };
            let kinds = [JobKind::Audit].into_iter().collect();
            let host = format!("host{number}");
            let config = WorkerConfig {
                nats,
                host,
                kinds,
                concurrency: 1,
                policies: Default::default(),
                designers: Default::default(),
            };
            let (stop, stopped) = watch::channel(false);
            swarm.stops.push(stop);
            swarm.workers.spawn(async move {
                // A worker ends only when it is stopped: the server has the same worlds.
                let _ = run_worker(config, stopped).await;
            });
        }
        swarm
    }

    /// Stops all workers but some.
    fn keep(&mut self, count: usize) {
        for stop in self.stops.drain(count..) {
            stop.send_replace(true);
        }
    }
}
