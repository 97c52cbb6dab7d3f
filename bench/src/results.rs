//! Durable results over HTTP: batches of 100, groups of 8, complete action logs, replay included, with small leases
//! meanwhile. The server is a process of its own; clients share its machine.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use api_types::{ReceiptStatus, ResultReceipt, ResultsResponse};
use env_core::rollout::roll_out;
use rayon::prelude::*;
use serde_json::{Value, json};
use system_tests::{ApiClient, Lease, ServerProcess, log_to_json};
use tokio::sync::Mutex;
use tokio::task::JoinSet;

use crate::Row;

const LEASES: usize = 90;
const GROUPS: usize = 100;
const GROUP_SIZE: usize = 8;
const BATCH: usize = 100;
const CLIENTS: usize = 4;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run())
}

async fn run() -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("bench.sqlite3");
    let server = ServerProcess::start(&file);
    let api = server.api();
    // No designer runs, because it would share the machine.
    let design = json!({"designer": "off"});
    let settings = json!({"strategy": "ladder", "id": "bench", "seed": 1, "group_size": GROUP_SIZE, "placement": false, "design": design});
    let created = api.post("/v1/runs", settings).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);

    // Bodies are built before the measurement, so that rollouts of this process are not measured.
    let start = Instant::now();
    let mut batches = Vec::new();
    for _ in 0..LEASES {
        batches.extend(lease_and_build_batches(&api, "bench").await?);
    }
    let groups_per_s = LEASES as f64 * GROUPS as f64 / start.elapsed().as_secs_f64();
    let result_count = batches.len() * BATCH;
    let bytes: usize = batches.iter().map(String::len).sum();

    let (done, leasing) = {
        let (done, stop) = tokio::sync::oneshot::channel::<()>();
        (done, tokio::spawn(measure_leases(api.clone(), stop)))
    };
    let start = Instant::now();
    send_all_batches(&api, batches).await?;
    let seconds = start.elapsed().as_secs_f64();
    drop(done);
    let LeaseLatency { median_ms, p99_ms } = leasing.await?;
    let rate = result_count as f64 / seconds;
    let stored = database_bytes(server, &file)?;
    Ok(vec![
        Row {
            label: format!(
                "durable results over HTTP, batches of {BATCH}, groups of {GROUP_SIZE}, {} bytes each",
                bytes / result_count
            ),
            measured: format!("{rate:.0} results/s"),
            goal: "≥ 5000 results/s".into(),
            ratio: Some(rate / 5000.0),
        },
        Row {
            label: "scenarios drawn, bracketed and leased (with rollouts here)".into(),
            measured: format!("{groups_per_s:.0} groups/s"),
            goal: String::new(),
            ratio: None,
        },
        Row {
            label: "lease of one group under that load".into(),
            measured: format!("{median_ms:.1} ms median, {p99_ms:.1} p99"),
            goal: "p99 < 20 ms".into(),
            ratio: Some(20.0 / p99_ms),
        },
        Row {
            label: "database size per result: log, scenario, bracket, outcome and failures".into(),
            measured: format!("{:.0} bytes", stored as f64 / result_count as f64),
            goal: String::new(),
            ratio: None,
        },
    ])
}

/// Stops the server and returns the size of its database in bytes, after the checkpoint.
pub(crate) fn database_bytes(server: ServerProcess, file: &Path) -> anyhow::Result<u64> {
    let code = server.terminate();
    anyhow::ensure!(code == Some(0), "the server stopped with {code:?}");
    Ok(std::fs::metadata(file)?.len())
}

/// Sends all batches with several concurrent clients.
async fn send_all_batches(api: &ApiClient, batches: Vec<String>) -> anyhow::Result<()> {
    let queue = Arc::new(Mutex::new(batches));
    let mut clients: JoinSet<anyhow::Result<()>> = JoinSet::new();
    for _ in 0..CLIENTS {
        let (api, queue) = (api.clone(), Arc::clone(&queue));
        clients.spawn(async move {
            loop {
                let Some(body) = queue.lock().await.pop() else { return Ok(()) };
                send_batch(&api, "bench", body).await?;
            }
        });
    }
    while let Some(client) = clients.join_next().await {
        client??;
    }
    Ok(())
}

/// Sends a batch whose results must all count; returns their number.
pub(crate) async fn send_batch(api: &ApiClient, run: &str, body: String) -> anyhow::Result<u64> {
    let response = api.request("POST", &format!("/v1/runs/{run}/results"), "application/json", body).await;
    let ResultsResponse { results, .. } = response.parse()?;
    let counted = results.iter().filter(|receipt| is_counted(receipt)).count();
    anyhow::ensure!(counted == results.len(), "not every result counted: {results:?}");
    Ok(counted as u64)
}

/// True if the server stored the episode as reported in time.
pub(crate) fn is_counted(receipt: &ResultReceipt) -> bool {
    matches!(receipt.status, ReceiptStatus::Counted | ReceiptStatus::Stored)
}

/// Leases groups and returns batches of results for them.
pub(crate) async fn lease_and_build_batches(api: &ApiClient, run: &str) -> anyhow::Result<Vec<String>> {
    build_batches(&api.lease(run, json!({"groups": GROUPS, "ttl_s": 3600})).await)
}

/// Builds batches of results. The `frozen` policy (a reflex with random weights) runs every episode: its actions are varied,
/// and some agents are lost.
fn build_batches(lease: &Lease) -> anyhow::Result<Vec<String>> {
    let results: Vec<Value> = lease
        .episodes()
        .into_par_iter()
        .enumerate()
        .map(|(i, (episode, scenario))| {
            let mut policy = scenario.task().policy("frozen", &scenario, i as u64)?;
            let log = roll_out(&scenario, &mut *policy)?.log;
            Ok(json!({"episode": episode, "actions": log_to_json(&log)}))
        })
        .collect::<anyhow::Result<_>>()?;
    Ok(results.chunks(BATCH).map(|batch| json!({ "results": batch }).to_string()).collect())
}

/// Latency of lease requests.
pub(crate) struct LeaseLatency {
    /// Median latency in milliseconds.
    pub(crate) median_ms: f64,
    /// 99th percentile in milliseconds.
    pub(crate) p99_ms: f64,
}

/// Leases one group at a time until `stop` closes; returns the latency of the requests.
pub(crate) async fn measure_leases(
    api: ApiClient,
    mut stop: tokio::sync::oneshot::Receiver<()>,
) -> LeaseLatency {
    let mut times = Vec::new();
    while matches!(stop.try_recv(), Err(tokio::sync::oneshot::error::TryRecvError::Empty)) {
        let start = Instant::now();
        let response = api.post("/v1/runs/bench/leases", json!({"groups": 1, "ttl_s": 3600})).await;
        if response.status == 201 {
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times.get((times.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    LeaseLatency { median_ms: at(0.5), p99_ms: at(0.99) }
}
