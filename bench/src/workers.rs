//! Workers on NATS: what an audited result costs the server with a worker and without one, and what that means for many workers.

use std::io::Write;
use std::time::{Duration, Instant};

use anyhow::Context;
use serde_json::json;
use system_tests::nats_server::NatsServer;
use system_tests::worker_cluster::WorkerCluster;

use crate::sockets::process::cpu_s;
use crate::{Row, job_cost};

/// Groups of a measurement.
const GROUPS: usize = 12;
/// Episodes of a group.
const GROUP_SIZE: usize = 8;
/// Episodes in a report.
const REPORTED_TOGETHER: usize = 16;
/// Time over which the CPU time of idle processes is measured.
const IDLE_TIME: Duration = Duration::from_secs(2);
/// Part of the CPU time without workers that is left with one: the goal for full audits.
const GOAL: f64 = 0.35;

/// Cores of the server and of each worker in the calculation for many workers.
const CORES: f64 = 4.0;
/// Durable results a second of one writer: the lower end of what `results` measures.
const WRITER_LIMIT: f64 = 6500.0;
/// Numbers of workers of the calculation.
const WORKERS: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];
/// Servers of the calculation, each with an equal part of the workers.
const SERVERS: [f64; 2] = [1.0, 4.0];

/// Cost of the results of a task.
struct ResultCost {
    /// CPU time of the server for a result, ms.
    server_ms: f64,
    /// CPU time of the worker for a result, ms.
    worker_ms: f64,
    /// Number of jobs that the worker did.
    remote_jobs: u64,
    /// Bytes of a job and its result, on average.
    bytes_per_job: f64,
}

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(async {
        let mut rows = Vec::new();
        for (task, policy, goal) in
            [("tasking/scanning", "blind", Some(GOAL)), ("kessler/formation", "hold", None)]
        {
            let alone = cost_of_results(false, task, policy).await?;
            let helped = cost_of_results(true, task, policy).await?;
            let ratio = helped.server_ms / alone.server_ms;
            rows.push(Row {
                label: format!("CPU of the server for a result of {task}, with a worker / without"),
                measured: format!("{:.2} / {:.2} ms = {ratio:.2}", helped.server_ms, alone.server_ms),
                goal: goal.map_or_else(|| "local by default".to_owned(), |goal| format!("≤ {goal}")),
                ratio: goal.map(|goal| goal / ratio),
            });
            let cost = format!("{:.0} bytes, {:.2} ms of the worker", helped.bytes_per_job, helped.worker_ms);
            rows.push(Row::plain(format!("{} jobs of {task}: a job, a result", helped.remote_jobs), cost));
            rows.extend(many_workers(task, &alone, &helped));
        }
        rows.extend(job_cost::measure("kessler/formation", "hold").await?);
        Ok(rows)
    })
}

/// Calculates results a second for many workers. The smallest of three limits counts: the writer, the cores of the server for what it
/// does itself, and the cores of the workers. Network and NATS are assumed not to be limits.
fn many_workers(task: &str, alone: &ResultCost, helped: &ResultCost) -> Vec<Row> {
    let on_server = |cost: &ResultCost| WRITER_LIMIT.min(1e3 * CORES / cost.server_ms);
    let mut rows = vec![Row::plain(
        format!("calculated results/s of {task}: a server of {CORES} cores without workers"),
        format!("{:.0}", on_server(alone)),
    )];
    for servers in SERVERS {
        for workers in WORKERS.into_iter().filter(|workers| *workers >= servers) {
            let computed = 1e3 * CORES * workers / servers / helped.worker_ms;
            let (limit, name) = [
                (WRITER_LIMIT, "the writer"),
                (1e3 * CORES / helped.server_ms, "cores of the server"),
                (computed, "the workers"),
            ]
            .into_iter()
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((0.0, ""));
            rows.push(Row::plain(
                format!(
                    "calculated results/s of {task}: {servers} servers, {workers} workers of {CORES} cores"
                ),
                format!("{:.0} (limit: {name})", servers * limit),
            ));
        }
    }
    rows
}

/// CPU times of the server and the worker in seconds, at a time.
struct CpuTimes {
    server_s: f64,
    worker_s: f64,
    at: Instant,
}

impl CpuTimes {
    fn now(cluster: &WorkerCluster) -> anyhow::Result<Self> {
        let worker_s = cluster.workers.first().map_or(Ok(0.0), |worker| cpu_s(worker.pid()))?;
        Ok(Self { server_s: cpu_s(cluster.server().pid())?, worker_s, at: Instant::now() })
    }

    /// Returns the CPU times of server and worker, and the duration, since an earlier point; in seconds.
    fn since(&self, before: &Self) -> (f64, f64, f64) {
        let seconds = self.at.duration_since(before.at).as_secs_f64();
        (self.server_s - before.server_s, self.worker_s - before.worker_s, seconds)
    }
}

/// Reports groups of a task, and measures the CPU time of the server and the worker until all episodes are criticised.
async fn cost_of_results(has_worker: bool, task: &str, policy: &str) -> anyhow::Result<ResultCost> {
    let nats = match has_worker {
        true => Some(NatsServer::start().context("the package index has no NATS server")?),
        false => None,
    };
    let cluster = WorkerCluster::start(nats, usize::from(has_worker)).await;
    let api = cluster.api();
    let run = json!({"id": "run", "seed": 3, "group_size": GROUP_SIZE, "design": {"designer": "off"}, "tasks": [task]});
    let created = api.post("/v1/runs", run).await;
    anyhow::ensure!(created.status == 201, "{}", created.body);
    let results = api.lease("run", json!({ "groups": GROUPS })).await.results(policy);
    cluster.wait_for_scenarios().await;
    // The CPU time of idle processes, for heartbeats and checkpoints, is subtracted.
    let idle = CpuTimes::now(&cluster)?;
    tokio::time::sleep(IDLE_TIME).await;
    let before = CpuTimes::now(&cluster)?;
    let (idle_server_s, idle_worker_s, idle_s) = before.since(&idle);
    for part in results.chunks(REPORTED_TOGETHER) {
        api.report("run", part.to_vec()).await;
    }
    cluster.wait_for_background_work().await;
    let (server_s, worker_s, seconds) = CpuTimes::now(&cluster)?.since(&before);
    let counters = cluster.list().await["counters"].clone();
    let count = |field: &str| counters[field].as_u64().unwrap_or(0);
    let ms_per_result =
        |spent: f64, idle: f64| 1e3 * (spent - idle / idle_s * seconds) / results.len() as f64;
    let cost = ResultCost {
        server_ms: ms_per_result(server_s, idle_server_s),
        worker_ms: ms_per_result(worker_s, idle_worker_s),
        remote_jobs: count("done_remotely"),
        bytes_per_job: (count("bytes_sent") + count("bytes_received")) as f64
            / count("done_remotely").max(1) as f64,
    };
    writeln!(
        std::io::stderr(),
        "{task}: {:.2} ms of the server, {:.2} ms of the worker",
        cost.server_ms,
        cost.worker_ms
    )?;
    Ok(cost)
}
