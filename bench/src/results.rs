//! Durable results over HTTP: a real server in a process of its own, batches of 100, groups of 8, whole action logs,
//! replay included, and leases taken while that goes on. Clients share the machine with the server.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use env_core::rollout::fly;
use rayon::prelude::*;
use serde_json::{Value, json};
use system_tests::{Api, Lease, Process, wire};
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
    let server = Process::start(&file);
    let api = server.api();
    // Nothing is designed beside: that would share the machine.
    let design = json!({"designer": "off"});
    let wish =
        json!({"id": "bench", "seed": 1, "group_size": GROUP_SIZE, "placement": false, "design": design});
    let created = api.post("/v1/runs", wish).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);

    // Bodies are made before the clock starts: what is measured is the server, not this program's flying.
    let start = Instant::now();
    let mut batches = Vec::new();
    for _ in 0..LEASES {
        batches.extend(prepared(&api, "bench").await?);
    }
    let prepared = LEASES as f64 * GROUPS as f64 / start.elapsed().as_secs_f64();
    let results: usize = batches.len() * BATCH;
    let bytes: usize = batches.iter().map(String::len).sum();

    let (done, leasing) = {
        let (done, until) = tokio::sync::oneshot::channel::<()>();
        (done, tokio::spawn(lease_times(api.clone(), until)))
    };
    let start = Instant::now();
    send_all(&api, batches).await?;
    let seconds = start.elapsed().as_secs_f64();
    drop(done);
    let (median, p99) = leasing.await?;
    let rate = results as f64 / seconds;
    let stored = stored(server, &file)?;
    Ok(vec![
        Row {
            what: format!(
                "durable results over HTTP, batches of {BATCH}, groups of {GROUP_SIZE}, {} bytes each",
                bytes / results
            ),
            measured: format!("{rate:.0} results/s"),
            goal: "≥ 5000 results/s".into(),
            ratio: Some(rate / 5000.0),
        },
        Row {
            what: "scenarios drawn, bracketed and leased (and flown here)".into(),
            measured: format!("{prepared:.0} groups/s"),
            goal: String::new(),
            ratio: None,
        },
        Row {
            what: "a lease of one group, under that load".into(),
            measured: format!("{median:.1} ms median, {p99:.1} p99"),
            goal: "p99 < 20 ms".into(),
            ratio: Some(20.0 / p99),
        },
        Row {
            what: "the database after that, a result: its log, scenario, bracket, outcome and failures"
                .into(),
            measured: format!("{:.0} bytes", stored as f64 / results as f64),
            goal: String::new(),
            ratio: None,
        },
    ])
}

/// Bytes of a server's database, once it has stopped and folded in all that it wrote.
pub(crate) fn stored(server: Process, file: &Path) -> anyhow::Result<u64> {
    let code = server.terminate();
    anyhow::ensure!(code == Some(0), "the server stopped with {code:?}");
    Ok(std::fs::metadata(file)?.len())
}

/// Sends every batch, several clients at a time.
async fn send_all(api: &Api, batches: Vec<String>) -> anyhow::Result<()> {
    let queue = Arc::new(Mutex::new(batches));
    let mut clients: JoinSet<anyhow::Result<()>> = JoinSet::new();
    for _ in 0..CLIENTS {
        let (api, queue) = (api.clone(), Arc::clone(&queue));
        clients.spawn(async move {
            loop {
                let Some(body) = queue.lock().await.pop() else { return Ok(()) };
                send(&api, "bench", body).await?;
            }
        });
    }
    while let Some(client) = clients.join_next().await {
        client??;
    }
    Ok(())
}

/// Sends a batch, every result of which must count; how many there were.
pub(crate) async fn send(api: &Api, run: &str, body: String) -> anyhow::Result<u64> {
    let answer = api.raw("POST", &format!("/v1/runs/{run}/results"), "application/json", body).await;
    let counted = answer.body["results"]
        .as_array()
        .filter(|all| all.iter().all(|r| matches!(r["status"].as_str(), Some("counted" | "stored"))));
    let Some(counted) = counted else {
        anyhow::bail!("not every result counted: {} {}", answer.status, answer.body);
    };
    Ok(counted.len() as u64)
}

/// Batches of a lease that is taken for them.
pub(crate) async fn prepared(api: &Api, run: &str) -> anyhow::Result<Vec<String>> {
    bodies(&lease(api, run).await?)
}

async fn lease(api: &Api, run: &str) -> anyhow::Result<Lease> {
    for _ in 0..60 {
        let wish = json!({"groups": GROUPS, "ttl_s": 3600});
        let answer = api.post(&format!("/v1/runs/{run}/leases"), wish).await;
        match answer.status {
            201 => return Ok(Lease(answer.body)),
            429 | 503 => tokio::time::sleep(Duration::from_millis(200)).await,
            _ => anyhow::bail!("no lease: {}", answer.body),
        }
    }
    anyhow::bail!("the server prepares too slowly")
}

/// Batches of results, ready to be sent. Every episode is flown by the task's reflex at random numbers: actions of all
/// kinds, some agents lost.
fn bodies(lease: &Lease) -> anyhow::Result<Vec<String>> {
    let flown: Vec<Value> = lease
        .episodes()
        .into_par_iter()
        .enumerate()
        .map(|(i, (episode, scenario))| {
            let mut policy = scenario.task().policy("frozen", &scenario, i as u64)?;
            let (_, log) = fly(&scenario, &mut *policy)?;
            Ok(json!({"episode": episode, "actions": wire(&log)}))
        })
        .collect::<anyhow::Result<_>>()?;
    Ok(flown.chunks(BATCH).map(|batch| json!({ "results": batch }).to_string()).collect())
}

/// Takes small leases until told to stop: median and 99th percentile, milliseconds.
pub(crate) async fn lease_times(api: Api, mut until: tokio::sync::oneshot::Receiver<()>) -> (f64, f64) {
    let mut times = Vec::new();
    while matches!(until.try_recv(), Err(tokio::sync::oneshot::error::TryRecvError::Empty)) {
        let start = Instant::now();
        let answer = api.post("/v1/runs/bench/leases", json!({"groups": 1, "ttl_s": 3600})).await;
        if answer.status == 201 {
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times.get((times.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    (at(0.5), at(0.99))
}
