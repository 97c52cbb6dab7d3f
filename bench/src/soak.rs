//! Soak test: ten minutes of concurrent load on every interface, and the memory of the server.

use std::convert::Infallible;
use std::io::Write;
use std::time::{Duration, Instant};

use serde_json::json;
use system_tests::{ApiClient, ServerProcess, http_client};
use tokio::task::JoinSet;

use crate::sockets::process;
use crate::stepping::{TRACKS, VectorSession};
use crate::{Row, columns, results};

/// Largest allowed ratio of the memory of the last minutes to that of the first ones.
const MAX_GROWTH: f64 = 1.15;

pub(crate) fn measure(minutes: u32) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(minutes.max(4)))
}

async fn run(minutes: u32) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let server = ServerProcess::start(&folder.path().join("bench.sqlite3"));
    let api = server.api();
    for (id, size) in [("rows", 8), ("columns", 1), ("flown", 8)] {
        let settings = json!({"strategy": "ladder", "id": id, "seed": 1, "group_size": size, "placement": false,
                          "tasks": ["kessler/survival"], "design": {"designer": "off"}});
        let created = api.post("/v1/runs", settings).await;
        anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    }
    let mut clients: JoinSet<anyhow::Result<Infallible>> = JoinSet::new();
    clients.spawn(report_results(api.clone()));
    clients.spawn(report_results(api.clone()));
    clients.spawn(claim_columns(api.clone()));
    clients.spawn(read_events(format!("{}/v1/runs/rows/events", api.base())));
    clients.spawn(step_sessions(api.clone()));
    clients.spawn(consume_trajectories(api.clone()));
    let (start, mut memory) = (Instant::now(), Vec::new());
    for minute in 1..=minutes {
        let until = start + Duration::from_secs(60) * minute;
        tokio::select! {
            () = tokio::time::sleep_until(until.into()) => {}
            Some(ended) = clients.join_next() => match ended? {
                Ok(never) => match never {},
                Err(error) => return Err(error),
            },
        }
        let resident = process::resident_bytes(server.pid())? as f64 / f64::from(1 << 20);
        writeln!(std::io::stderr(), "minute {minute:2}: {resident:.0} MiB")?;
        memory.push(resident);
    }
    clients.shutdown().await;
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    // The first minute fills caches.
    let growth = mean(&memory[memory.len() - 2..]) / mean(&memory[1..3]);
    let minutes_mib: Vec<String> = memory.iter().map(|mib| format!("{mib:.0}")).collect();
    Ok(vec![Row {
        label: format!(
            "memory of the server under results, columns, trajectories, vector steps and events, MiB a minute: {}",
            minutes_mib.join(" ")
        ),
        measured: format!("{growth:.2} of minutes 2-3"),
        goal: format!("≤ {MAX_GROWTH}"),
        ratio: Some(MAX_GROWTH / growth),
    }])
}

async fn report_results(api: ApiClient) -> anyhow::Result<Infallible> {
    loop {
        for body in results::lease_and_build_batches(&api, "rows").await? {
            results::send_batch(&api, "rows", body).await?;
        }
    }
}

async fn claim_columns(api: ApiClient) -> anyhow::Result<Infallible> {
    loop {
        let claim = columns::prepare_claim(&api, "columns", 20_000).await?;
        columns::claim_columns(&api, "columns", &claim).await?;
    }
}

/// Opens vector sessions one after another and steps them with pauses, which leave time for the other clients.
async fn step_sessions(api: ApiClient) -> anyhow::Result<Infallible> {
    for seed in 0.. {
        let mut session = VectorSession::open(api.base(), TRACKS, 256, seed).await?;
        for _ in 0..200 {
            session.step().await?;
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }
    unreachable!("there is always another seed")
}

/// Claims and acknowledges groups of server rollouts.
async fn consume_trajectories(api: ApiClient) -> anyhow::Result<Infallible> {
    let run = "/v1/runs/flown";
    let settings = json!({"policy": "random", "version": 1}).to_string();
    let policy = api.request("PUT", &format!("{run}/policy"), "application/json", settings).await;
    anyhow::ensure!(policy.status == 200, "no policy: {}", policy.body);
    loop {
        let claim = json!({"limit": 4, "wait_s": 10});
        let claimed = api.post(&format!("{run}/trajectories/claim"), claim).await;
        anyhow::ensure!(claimed.status == 200, "nothing claimed: {}", claimed.body);
        let groups = claimed.body["groups"].as_array().cloned().unwrap_or_default();
        let ids: Vec<_> = groups.iter().map(|group| &group["id"]).collect();
        let acked = api.post(&format!("{run}/trajectories/ack"), json!({"ids": ids})).await;
        anyhow::ensure!(ids.is_empty() || acked.status == 200, "not acknowledged: {}", acked.body);
        // A pause, because the client shares the machine with the server.
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

/// Reads the event stream and reconnects now and then.
async fn read_events(url: String) -> anyhow::Result<Infallible> {
    loop {
        let mut stream = http_client().get(&url).send().await?;
        for _ in 0..2_000 {
            if stream.chunk().await?.is_none() {
                break;
            }
        }
    }
}
