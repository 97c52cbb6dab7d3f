//! Columns over HTTP: leases of 100 000 episodes, their columns in MessagePack, audits and their logs, all acknowledged on disk; a
//! real server in a process of its own, small leases taken meanwhile. Clients share the machine with the server.

use std::sync::Arc;
use std::time::Instant;

use env_core::{ActionLog, Recipe, Scenario, Seed};
use rayon::prelude::*;
use serde_json::{Value, json};
use system_tests::{Api, Lease, Process, flown, wire};

use crate::Row;
use crate::results::{lease_times, stored};

const LEASES: usize = 12;
const EPISODES: usize = 100_000;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run())
}

/// A lease whose columns are ready to be sent. Nothing was burnt in it: the scores are what holding earns.
pub(crate) struct Ready {
    lease: Lease,
    body: Vec<u8>,
}

async fn run() -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("bench.sqlite3");
    let server = Process::start(&file);
    let api = server.api();
    // Levels at which an episode is short work: what is measured is the feed.
    let wish = json!({"id": "bench", "seed": 1, "placement": false, "tasks": ["kessler/survival", "kessler/eco_station"],
                      "design": {"designer": "off"}});
    let created = api.post("/v1/runs", wish).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    let mut ready = Vec::new();
    for _ in 0..LEASES {
        ready.push(prepare(&api, "bench", EPISODES).await?);
    }
    let (done, leasing) = {
        let (done, until) = tokio::sync::oneshot::channel::<()>();
        (done, tokio::spawn(lease_times(api.clone(), until)))
    };
    let (start, mut audited, mut bytes) = (Instant::now(), 0, 0);
    for ready in &ready {
        bytes += ready.body.len();
        audited += claim(&api, "bench", ready).await?;
    }
    let seconds = start.elapsed().as_secs_f64();
    drop(done);
    let (_, p99) = leasing.await?;
    let rate = (LEASES * EPISODES) as f64 / seconds;
    let stored = stored(server, &file)?;
    Ok(vec![
        Row {
            what: format!(
                "episodes claimed in columns of {EPISODES}, {} audited and replayed, {:.1} bytes each",
                audited,
                bytes as f64 / (LEASES * EPISODES) as f64
            ),
            measured: format!("{rate:.0} episodes/s"),
            goal: "≥ 200000 episodes/s".into(),
            ratio: Some(rate / 200_000.0),
        },
        Row {
            what: "a lease of one group, under that load".into(),
            measured: format!("{p99:.1} ms p99"),
            goal: "p99 < 20 ms".into(),
            ratio: Some(20.0 / p99),
        },
        Row {
            what: "the database after that, a claimed episode".into(),
            measured: format!("{:.1} bytes", stored as f64 / (LEASES * EPISODES) as f64),
            goal: String::new(),
            ratio: None,
        },
    ])
}

/// The scenario of a group.
fn scenario(lease: &Lease, group: usize) -> anyhow::Result<Scenario> {
    let whole = |value: &Value, key: &str| value[key].as_u64().unwrap_or_default();
    let ranges = lease.0["ranges"].as_array().map_or(&[][..], Vec::as_slice);
    let holds = |range: &&Value| {
        (whole(range, "first")..whole(range, "first") + whole(range, "groups")).contains(&(group as u64))
    };
    let range = ranges.iter().find(holds).ok_or_else(|| anyhow::anyhow!("no range holds group {group}"))?;
    let recipe = Recipe::from_json(&lease.0["recipes"][whole(range, "recipe") as usize])?;
    let seed = whole(range, "seed") + group as u64 - whole(range, "first");
    Ok(Scenario::new(Arc::new(recipe), Seed::new(seed)?))
}

pub(crate) async fn prepare(api: &Api, run: &str, episodes: usize) -> anyhow::Result<Ready> {
    let wish = json!({"form": "columns", "groups": episodes, "ttl_s": 3600});
    let answer = api.post(&format!("/v1/runs/{run}/leases"), wish).await;
    anyhow::ensure!(answer.status == 201, "no lease: {}", answer.body);
    let lease = Lease(answer.body);
    let ranges = lease.0["ranges"].as_array().cloned().unwrap_or_default();
    let scores: Vec<Vec<f32>> = ranges
        .into_par_iter()
        .map(|range| {
            let recipe = &lease.0["recipes"][range["recipe"].as_u64().unwrap_or_default() as usize];
            let recipe = Arc::new(Recipe::from_json(recipe)?);
            let seed = range["seed"].as_u64().unwrap_or_default();
            let score = |group| {
                let scenario = Scenario::new(Arc::clone(&recipe), Seed::new(seed + group)?);
                Ok::<_, anyhow::Error>(held(&scenario))
            };
            (0..range["groups"].as_u64().unwrap_or_default()).map(score).collect()
        })
        .collect::<anyhow::Result<_>>()?;
    let bytes: Vec<u8> = scores.concat().iter().flat_map(|score| score.to_le_bytes()).collect();
    let mut body = b"\x81\xa5score\xc6".to_vec();
    body.extend_from_slice(&(bytes.len() as u32).to_be_bytes());
    body.extend_from_slice(&bytes);
    Ok(Ready { lease, body })
}

/// What holding earns; nothing where there is no fair start.
fn held(scenario: &Scenario) -> f32 {
    let width = scenario.task().action_space().columns.len();
    let mut log = ActionLog::new(width, env_core::log::Precision::F64);
    log.stopped = Some(env_core::Stopped::TooLate);
    env_core::rollout::replay(scenario, &log).map_or(0.0, |flown| flown.score as f32)
}

/// Sends columns, then the logs that are due; how many those were.
pub(crate) async fn claim(api: &Api, run: &str, Ready { lease, body }: &Ready) -> anyhow::Result<usize> {
    let path = format!("/v1/runs/{run}/leases/{}/columns", lease.id());
    let claim = api.raw("POST", &path, "application/msgpack", body.clone()).await;
    anyhow::ensure!(claim.status == 200, "not taken: {}", claim.body);
    let mut results = Vec::new();
    for audit in claim.body["audit"].as_array().cloned().unwrap_or_default() {
        let scenario = scenario(lease, audit["group"].as_u64().unwrap_or_default() as usize)?;
        let (_, log) = flown(&scenario, "hold");
        results.push(json!({"episode": audit["episodes"][0], "actions": wire(&log)}));
    }
    let due = results.len();
    let told = api.report(run, results).await;
    let fine = told["results"].as_array().is_some_and(|all| all.iter().all(|r| r["status"] == "audited"));
    anyhow::ensure!(fine, "an audit failed: {told}");
    let standing = api.get(&path).await;
    anyhow::ensure!(standing.body["state"] == "accepted", "not accepted: {}", standing.body);
    Ok(due)
}
