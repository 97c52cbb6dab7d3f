//! Cost of a job on a worker beside its computation: messages through NATS, and time on the way.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context;
use serde_json::{Value, json};
use system_tests::nats_server::NatsServer;
use system_tests::nginx::free_address;
use system_tests::worker_cluster::WorkerCluster;
use system_tests::{ApiClient, http_client};

use crate::Row;

/// Reports of one episode each, after those that fill caches.
const REPORTS: usize = 60;
/// Reports before the measurement.
const WARM_UP: usize = 10;
/// Time over which the messages of idle processes are counted.
const IDLE_TIME: Duration = Duration::from_secs(3);

/// Counts of a NATS server.
#[derive(Debug, Clone, Copy)]
struct NatsMessages {
    /// Messages that clients sent.
    sent: f64,
    /// Messages that clients received.
    received: f64,
}

impl NatsMessages {
    async fn read(monitor: &str) -> anyhow::Result<Self> {
        let answer = http_client().get(format!("http://{monitor}/varz")).send().await?;
        let counts: Value = serde_json::from_slice(&answer.bytes().await?)?;
        let count =
            |field: &str| counts[field].as_f64().with_context(|| format!("NATS does not count {field}"));
        Ok(Self { sent: count("in_msgs")?, received: count("out_msgs")? })
    }

    fn since(self, before: Self) -> Self {
        Self { sent: self.sent - before.sent, received: self.received - before.received }
    }
}

/// Reports of single episodes.
struct SingleReports {
    /// Median time of a report until its result is stored.
    median: Duration,
    /// Messages of a job; none without NATS.
    messages: Option<NatsMessages>,
}

/// Measures messages and time of the jobs of a task whose replays are cheap.
pub(crate) async fn measure(task: &str, policy: &str) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let monitor = free_address();
    let config = folder.path().join("nats.conf");
    std::fs::write(&config, format!("http: \"{monitor}\"\n"))?;
    let alone = report_singly(None, task, policy).await?;
    let helped =
        report_singly(Some(MonitoredNats { config: &config, monitor: &monitor }), task, policy).await?;
    let ms = |time: Duration| 1e3 * time.as_secs_f64();
    let NatsMessages { sent, received } = helped.messages.context("NATS counts messages")?;
    Ok(vec![
        Row::plain(
            format!("a job of {task}: messages of server and worker to NATS, and from it"),
            format!("{sent:.1} and {received:.1}"),
        ),
        Row::plain(
            format!("a report of one episode of {task}, median, by a worker / by the server"),
            format!("{:.2} / {:.2} ms", ms(helped.median), ms(alone.median)),
        ),
    ])
}

/// NATS server that counts its messages.
struct MonitoredNats<'a> {
    config: &'a Path,
    /// Address of its counts.
    monitor: &'a str,
}

/// Starts a server, with a worker if there is NATS, and a run.
async fn start(nats: Option<&MonitoredNats<'_>>, task: &str) -> anyhow::Result<WorkerCluster> {
    let server = match nats {
        Some(nats) => {
            let server = NatsServer::start_with(Some(nats.config.to_owned()), Vec::new());
            Some(server.context("the package index has no NATS server")?)
        }
        None => None,
    };
    let cluster = WorkerCluster::start(server, usize::from(nats.is_some())).await;
    let run =
        json!({"id": "run", "seed": 3, "group_size": 2, "design": {"designer": "off"}, "tasks": [task]});
    let created = cluster.api().post("/v1/runs", run).await;
    anyhow::ensure!(created.status == 201, "{}", created.body);
    Ok(cluster)
}

/// Reports results one after the other, and returns the time of each.
async fn report_each(api: &ApiClient, results: &[Value]) -> Vec<Duration> {
    let mut times = Vec::new();
    for result in results {
        let sent = Instant::now();
        api.report("run", vec![result.clone()]).await;
        times.push(sent.elapsed());
    }
    times
}

async fn report_singly(
    nats: Option<MonitoredNats<'_>>,
    task: &str,
    policy: &str,
) -> anyhow::Result<SingleReports> {
    let cluster = start(nats.as_ref(), task).await?;
    let api = cluster.api();
    let results = api.lease("run", json!({"groups": (REPORTS + WARM_UP).div_ceil(2)})).await.results(policy);
    cluster.wait_for_scenarios().await;
    let (warm_up, measured) = results.split_at(WARM_UP);
    report_each(&api, warm_up).await;
    cluster.wait_for_background_work().await;
    let count = async || match &nats {
        Some(nats) => NatsMessages::read(nats.monitor).await.map(Some),
        None => Ok(None),
    };
    let jobs = async || cluster.list().await["counters"]["done_remotely"].as_f64().unwrap_or(0.0);
    let idle_from = count().await?;
    tokio::time::sleep(IDLE_TIME).await;
    let (from, jobs_before, started) = (count().await?, jobs().await, Instant::now());
    let mut times = report_each(&api, measured).await;
    cluster.wait_for_background_work().await;
    let (to, jobs, elapsed) = (count().await?, jobs().await - jobs_before, started.elapsed());
    times.sort_unstable();
    let median = times.get(times.len() / 2).copied().unwrap_or_default();
    let messages = idle_from.zip(from).zip(to).map(|((idle_from, from), to)| {
        let (idle, spent) = (from.since(idle_from), to.since(from));
        let idle_share = elapsed.as_secs_f64() / IDLE_TIME.as_secs_f64();
        let of_a_job = |spent: f64, idle: f64| (spent - idle * idle_share) / jobs.max(1.0);
        NatsMessages {
            sent: of_a_job(spent.sent, idle.sent),
            received: of_a_job(spent.received, idle.received),
        }
    });
    Ok(SingleReports { median, messages })
}
