//! Sixty-four concurrent trainers for some minutes: latency of leases and results, and memory of the server.

use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use api_types::ResultsResponse;
use serde_json::{Value, json};
use system_tests::{ApiClient, Lease, ServerProcess, episode_result};
use tokio::task::JoinSet;

use crate::Row;
use crate::results::is_counted;
use crate::sockets::process;

const TRAINERS: usize = 64;
/// Groups of a lease.
const GROUPS: u32 = 2;
/// Episodes of a group.
const GROUP_SIZE: u32 = 4;
/// Pause of a trainer between its results and the next lease, in which a real one would learn.
const LEARNING_PAUSE: Duration = Duration::from_millis(500);
/// Largest allowed ratio of the memory at the end to that of the second minute.
const MAX_GROWTH: f64 = 1.15;

/// Durations of requests in milliseconds, and counts.
#[derive(Default)]
struct LoadStatistics {
    leases: Vec<f64>,
    results: Vec<f64>,
    /// Number of episodes that counted.
    counted: u64,
    /// Number of 429 and 503 responses.
    busy: u64,
}

type SharedStatistics = Arc<Mutex<LoadStatistics>>;

pub(crate) fn measure(minutes: u32) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(minutes.max(2)))
}

async fn run(minutes: u32) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let server = ServerProcess::start(&folder.path().join("bench.sqlite3"));
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "load", "seed": 1, "group_size": GROUP_SIZE});
    let created = api.post("/v1/runs", settings).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    let times = SharedStatistics::default();
    let mut trainers = JoinSet::new();
    for _ in 0..TRAINERS {
        trainers.spawn(train(ApiClient::new(api.base()), Arc::clone(&times)));
    }
    let (start, mut memory) = (Instant::now(), Vec::new());
    for minute in 1..=minutes {
        tokio::select! {
            () = tokio::time::sleep_until((start + Duration::from_secs(60) * minute).into()) => {}
            Some(ended) = trainers.join_next() => match ended? {
                Ok(never) => match never {},
                Err(error) => return Err(error),
            },
        }
        let mib = process::resident_bytes(server.pid())? as f64 / f64::from(1 << 20);
        memory.push(mib);
        writeln!(std::io::stderr(), "minute {minute}: {mib:.0} MiB")?;
    }
    trainers.shutdown().await;
    let mut times = times.lock().unwrap_or_else(PoisonError::into_inner);
    let counted = times.counted as f64 / start.elapsed().as_secs_f64();
    let busy = times.busy;
    let growth = memory[memory.len() - 1] / memory[1];
    let minutes_mib: Vec<String> = memory.iter().map(|mib| format!("{mib:.0}")).collect();
    Ok(vec![
        Row::plain(
            format!("{TRAINERS} trainers for {minutes} minutes, leases of {GROUPS} groups of {GROUP_SIZE}"),
            format!("{counted:.0} episodes/s; {busy} retries"),
        ),
        Row::plain("lease", format_quantiles(&mut times.leases)),
        Row::plain("results of a lease, replayed and committed", format_quantiles(&mut times.results)),
        Row {
            label: format!("memory of the server, MiB a minute: {}", minutes_mib.join(" ")),
            measured: format!("{growth:.2} of minute 2"),
            goal: format!("≤ {MAX_GROWTH}"),
            ratio: Some(MAX_GROWTH / growth),
        },
    ])
}

fn format_quantiles(times: &mut [f64]) -> String {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times.get((times.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    format!("{:.1} ms median, {:.1} p99 of {}", at(0.5), at(0.99), times.len())
}

async fn train(api: ApiClient, times: SharedStatistics) -> anyhow::Result<std::convert::Infallible> {
    loop {
        let lease = Lease(
            request_until_accepted(&api, &times, "leases", &json!({"groups": GROUPS, "ttl_s": 600})).await?,
        );
        let results = tokio::task::spawn_blocking(move || {
            let episodes = lease.episodes().into_iter();
            episodes.map(|(id, scenario)| episode_result(&id, &scenario, "hold")).collect::<Vec<Value>>()
        });
        let response =
            request_until_accepted(&api, &times, "results", &json!({"results": results.await?})).await?;
        let response: ResultsResponse = serde_json::from_value(response)?;
        let counted = response.results.iter().filter(|receipt| is_counted(receipt)).count();
        times.lock().unwrap_or_else(PoisonError::into_inner).counted += counted as u64;
        tokio::time::sleep(LEARNING_PAUSE).await;
    }
}

/// Sends a request until the server accepts it, and records the duration of each attempt.
async fn request_until_accepted(
    api: &ApiClient,
    times: &SharedStatistics,
    resource: &str,
    body: &Value,
) -> anyhow::Result<Value> {
    loop {
        let start = Instant::now();
        let response = api.post(&format!("/v1/runs/load/{resource}"), body.clone()).await;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let is_busy = matches!(response.status, 429 | 503);
        {
            let mut times = times.lock().unwrap_or_else(PoisonError::into_inner);
            if resource == "leases" {
                times.leases.push(ms);
            } else {
                times.results.push(ms);
            }
            times.busy += u64::from(is_busy);
        }
        if !is_busy {
            anyhow::ensure!(
                matches!(response.status, 200 | 201),
                "{resource}: {} {}",
                response.status,
                response.body
            );
            return Ok(response.body);
        }
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}
