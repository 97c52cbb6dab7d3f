//! Ten minutes of everything that a trainer team asks for at once, and what the server's memory does meanwhile.

use std::convert::Infallible;
use std::io::Write;
use std::time::{Duration, Instant};

use serde_json::json;
use system_tests::{Api, Process, http_client};
use tokio::task::JoinSet;

use crate::sockets::process;
use crate::stepping::Session;
use crate::{Row, columns, results};

/// Memory of the last minutes over that of the first ones, at most.
const FLAT: f64 = 1.15;

pub(crate) fn measure(minutes: u32) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(minutes.max(4)))
}

async fn run(minutes: u32) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let server = Process::start(&folder.path().join("bench.sqlite3"));
    let api = server.api();
    for (id, size) in [("rows", 8), ("columns", 1), ("flown", 8)] {
        let wish = json!({"id": id, "seed": 1, "group_size": size, "placement": false,
                          "tasks": ["kessler/survival"], "design": {"designer": "off"}});
        let created = api.post("/v1/runs", wish).await;
        anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    }
    let mut work: JoinSet<anyhow::Result<Infallible>> = JoinSet::new();
    work.spawn(rows(api.clone()));
    work.spawn(rows(api.clone()));
    work.spawn(claims(api.clone()));
    work.spawn(listen(format!("{}/v1/runs/rows/events", api.base())));
    work.spawn(steps(api.clone()));
    work.spawn(pulls(api.clone()));
    let (begun, mut memory) = (Instant::now(), Vec::new());
    for minute in 1..=minutes {
        let until = begun + Duration::from_secs(60) * minute;
        tokio::select! {
            () = tokio::time::sleep_until(until.into()) => {}
            Some(ended) = work.join_next() => match ended? {
                Ok(never) => match never {},
                Err(error) => return Err(error),
            },
        }
        let resident = process::resident(server.pid())? as f64 / f64::from(1 << 20);
        writeln!(std::io::stderr(), "minute {minute:2}: {resident:.0} MiB")?;
        memory.push(resident);
    }
    work.shutdown().await;
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    // The first minute warms caches up.
    let growth = mean(&memory[memory.len() - 2..]) / mean(&memory[1..3]);
    let told: Vec<String> = memory.iter().map(|mib| format!("{mib:.0}")).collect();
    Ok(vec![Row {
        what: format!(
            "memory of the server under results, columns, trajectories, vector steps and events, MiB a minute: {}",
            told.join(" ")
        ),
        measured: format!("{growth:.2} of minutes 2-3"),
        goal: format!("≤ {FLAT}"),
        ratio: Some(FLAT / growth),
    }])
}

async fn rows(api: Api) -> anyhow::Result<Infallible> {
    loop {
        for body in results::prepared(&api, "rows").await? {
            results::send(&api, "rows", body).await?;
        }
    }
}

async fn claims(api: Api) -> anyhow::Result<Infallible> {
    loop {
        let ready = columns::prepare(&api, "columns", 20_000).await?;
        columns::claim(&api, "columns", &ready).await?;
    }
}

/// Vector sessions that come and go, stepped now and then: who steps without a pause leaves nothing to the others.
async fn steps(api: Api) -> anyhow::Result<Infallible> {
    for seed in 0.. {
        let mut session = Session::open(api.base(), 256, seed).await?;
        for _ in 0..200 {
            session.step().await?;
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }
    unreachable!("there is always another seed")
}

/// A trainer that learns from what the server flies.
async fn pulls(api: Api) -> anyhow::Result<Infallible> {
    let run = "/v1/runs/flown";
    let wish = json!({"policy": "random", "version": 1}).to_string();
    let policy = api.raw("PUT", &format!("{run}/policy"), "application/json", wish).await;
    anyhow::ensure!(policy.status == 200, "no policy: {}", policy.body);
    loop {
        let pulled = api.get(&format!("{run}/trajectories?limit=4&wait_s=10")).await;
        anyhow::ensure!(pulled.status == 200, "nothing pulled: {}", pulled.body);
        let groups = pulled.body["groups"].as_array().cloned().unwrap_or_default();
        let ids: Vec<_> = groups.iter().map(|group| &group["id"]).collect();
        let told = api.post(&format!("{run}/trajectories/ack"), json!({"ids": ids})).await;
        anyhow::ensure!(ids.is_empty() || told.status == 200, "not acknowledged: {}", told.body);
        // As fast as is polite: it shares the machine with what else is measured.
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

/// Somebody who listens, goes, and comes again.
async fn listen(url: String) -> anyhow::Result<Infallible> {
    loop {
        let mut stream = http_client().get(&url).send().await?;
        for _ in 0..2_000 {
            if stream.chunk().await?.is_none() {
                break;
            }
        }
    }
}
