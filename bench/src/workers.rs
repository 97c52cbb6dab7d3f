//! CPU time of a server for an audited result, with a worker on NATS and without one, in alternation.

use std::time::{Duration, Instant};

use anyhow::Context;
use serde_json::json;
use system_tests::nats_server::NatsServer;
use system_tests::worker_cluster::WorkerCluster;

use crate::Row;
use crate::sockets::process::cpu_s;

/// Groups of a measurement.
const GROUPS: usize = 12;
/// Episodes of a group.
const GROUP_SIZE: usize = 8;
/// Episodes in a report.
const REPORTED_TOGETHER: usize = 16;
/// Time over which the CPU time of an idle server is measured.
const IDLE_TIME: Duration = Duration::from_secs(2);
/// Part of the CPU time without workers that is left with one: the goal for full audits.
const GOAL: f64 = 0.35;

/// Cost of the results of a task.
struct ResultCost {
    /// CPU time of the server for a result, ms.
    cpu_ms: f64,
    /// Number of jobs that the worker did.
    remote_jobs: u64,
    /// Bytes of a job and its result, on average.
    bytes_per_job: f64,
}

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(async {
        let mut rows = Vec::new();
        for (task, policy, goal) in [("tasking/scanning", "blind", Some(GOAL)), ("kessler/formation", "hold", None)] {
            let alone = cost_of_results(false, task, policy).await?;
            let helped = cost_of_results(true, task, policy).await?;
            let ratio = helped.cpu_ms / alone.cpu_ms;
            rows.push(Row {
                label: format!(
                    "CPU of the server for a result of {task}, with a worker / without ({} jobs of {:.0} bytes)",
                    helped.remote_jobs, helped.bytes_per_job
                ),
                measured: format!("{:.2} / {:.2} ms = {ratio:.2}", helped.cpu_ms, alone.cpu_ms),
                goal: goal.map_or_else(|| "local by default".to_owned(), |goal| format!("≤ {goal}")),
                ratio: goal.map(|goal| goal / ratio),
            });
        }
        Ok(rows)
    })
}

/// Reports groups of a task, and measures the CPU time of the server until all episodes are criticised.
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
    let pid = cluster.server().pid();
    // The CPU time of an idle server, for heartbeats and checkpoints, is subtracted.
    let (idle, idle_from) = (cpu_s(pid)?, Instant::now());
    tokio::time::sleep(IDLE_TIME).await;
    let idle_rate = (cpu_s(pid)? - idle) / idle_from.elapsed().as_secs_f64();
    let (before, started) = (cpu_s(pid)?, Instant::now());
    for part in results.chunks(REPORTED_TOGETHER) {
        api.report("run", part.to_vec()).await;
    }
    cluster.wait_for_background_work().await;
    let spent = cpu_s(pid)? - before - idle_rate * started.elapsed().as_secs_f64();
    let counters = cluster.list().await["counters"].clone();
    let count = |field: &str| counters[field].as_u64().unwrap_or(0);
    let bytes = count("bytes_sent") + count("bytes_received");
    Ok(ResultCost {
        cpu_ms: 1e3 * spent / results.len() as f64,
        remote_jobs: count("done_remotely"),
        bytes_per_job: bytes as f64 / count("done_remotely").max(1) as f64,
    })
}
