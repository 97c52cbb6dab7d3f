//! Clients that send one byte a second on two thousand connections, while trainers work.

use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde_json::json;
use system_tests::scale::send_slowly;
use system_tests::{ApiClient, ServerProcess};
use tokio::task::JoinSet;

use super::p99;
use crate::sockets::process;
use crate::{Row, results};

/// Number of trainers in each phase.
const TRAINERS: usize = 4;
/// Duration of each of the four phases: without, with, with and without slow clients.
const PHASE: Duration = Duration::from_secs(30);
/// Goal: the 99th percentile with slow clients is at most this multiple of that without.
const GOAL: f64 = 1.25;

pub(crate) fn measure(connections: usize) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(connections))
}

async fn run(connections: usize) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let server = ServerProcess::start(&folder.path().join("bench.sqlite3"));
    let settings = json!({"id": "bench", "seed": 1, "group_size": 8, "placement": false,
                          "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let created = server.api().post("/v1/runs", settings).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    let (mut without, mut with, mut closed) = (Vec::new(), Vec::new(), 0);
    let mut memory = [0.0; 2];
    for is_slow in [false, true, true, false] {
        let (opened, closed_by_server) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
        let mut slow = JoinSet::new();
        for _ in 0..if is_slow { connections } else { 0 } {
            let (address, opened, closed) =
                (server.address().to_owned(), Arc::clone(&opened), Arc::clone(&closed_by_server));
            slow.spawn(async move { send_slowly(address, &opened, &closed).await });
        }
        while opened.load(Ordering::Relaxed) < u64::try_from(slow.len())? {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        let times = train(&server.api()).await?;
        memory[usize::from(is_slow)] = process::resident_bytes(server.pid())? as f64 / f64::from(1 << 20);
        if is_slow {
            with.extend(times);
        } else {
            without.extend(times);
        }
        closed += closed_by_server.load(Ordering::Relaxed);
        slow.shutdown().await;
        writeln!(
            std::io::stderr(),
            "slow clients: {is_slow}; {} requests so far",
            with.len() + without.len()
        )?;
    }
    let (p99_without, p99_with) = (p99(&mut without), p99(&mut with));
    Ok(vec![
        Row {
            label: format!("p99 of results beside {connections} connections of one byte/s"),
            measured: format!("{p99_with:.1} ms, {p99_without:.1} without"),
            goal: format!("≤ {GOAL} × without"),
            ratio: Some(GOAL * p99_without / p99_with),
        },
        Row {
            label: format!("memory of the server; the server closed {closed} of the connections"),
            measured: format!("{:.0} MiB, {:.0} without", memory[1], memory[0]),
            goal: String::new(),
            ratio: None,
        },
    ])
}

/// Lets trainers lease and report for a phase; returns the durations of the reports, milliseconds.
async fn train(api: &ApiClient) -> anyhow::Result<Vec<f64>> {
    let until = Instant::now() + PHASE;
    let mut trainers: JoinSet<anyhow::Result<Vec<f64>>> = JoinSet::new();
    for _ in 0..TRAINERS {
        let api = api.clone();
        trainers.spawn(async move {
            let mut times = Vec::new();
            while Instant::now() < until {
                for body in results::lease_and_build_batches(&api, "bench").await? {
                    let start = Instant::now();
                    results::send_batch(&api, "bench", body).await?;
                    times.push(start.elapsed().as_secs_f64() * 1e3);
                }
            }
            Ok(times)
        });
    }
    let mut times = Vec::new();
    while let Some(trained) = trainers.join_next().await {
        times.extend(trained??);
    }
    Ok(times)
}
