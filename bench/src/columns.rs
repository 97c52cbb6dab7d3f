//! Column claims over HTTP: leases of 100 000 episodes with columns in MessagePack, audits and logs, all acknowledged after
//! their commit. The server is a process of its own, and small leases are measured meanwhile. Clients share its machine.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;
use api_types::{
    ClaimState, ColumnClaim, Lease, LeaseForm, LeaseRequest, ReceiptStatus, ResultsResponse, SeedRange,
};
use env_core::{ActionLog, Recipe, Scenario, Seed};
use rayon::prelude::*;
use serde_json::json;
use system_tests::{ApiClient, ServerProcess, log_to_json, run_policy};

use crate::Row;
use crate::results::{database_bytes, measure_leases};

const LEASES: usize = 12;
const EPISODES: usize = 100_000;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run())
}

/// Lease with an encoded claim of the scores of a holding policy.
pub(crate) struct PreparedClaim {
    lease: Lease,
    body: Vec<u8>,
}

async fn run() -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("bench.sqlite3");
    let server = ServerProcess::start(&file);
    let api = server.api();
    // Levels with episodes that run quickly, because the benchmark measures the feed.
    let request = json!({"strategy": "ladder", "id": "bench", "seed": 1, "placement": false, "tasks": ["kessler/survival", "kessler/eco_station"],
                      "design": {"designer": "off"}});
    let created = api.post("/v1/runs", request).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    let mut claims = Vec::new();
    for _ in 0..LEASES {
        claims.push(prepare_claim(&api, "bench", EPISODES).await?);
    }
    let (done, leasing) = {
        let (done, stop) = tokio::sync::oneshot::channel::<()>();
        (done, tokio::spawn(measure_leases(api.clone(), stop)))
    };
    let (start, mut audited, mut bytes) = (Instant::now(), 0, 0);
    for claim in &claims {
        bytes += claim.body.len();
        audited += claim_columns(&api, "bench", claim).await?;
    }
    let seconds = start.elapsed().as_secs_f64();
    drop(done);
    let p99 = leasing.await?.p99_ms;
    let rate = (LEASES * EPISODES) as f64 / seconds;
    let stored = database_bytes(server, &file)?;
    Ok(vec![
        Row {
            label: format!(
                "episodes claimed in columns of {EPISODES}, {} audited and replayed, {:.1} bytes each",
                audited,
                bytes as f64 / (LEASES * EPISODES) as f64
            ),
            measured: format!("{rate:.0} episodes/s"),
            goal: "≥ 200000 episodes/s".into(),
            ratio: Some(rate / 200_000.0),
        },
        Row {
            label: "a lease of one group, under that load".into(),
            measured: format!("{p99:.1} ms p99"),
            goal: "p99 < 20 ms".into(),
            ratio: Some(20.0 / p99),
        },
        Row {
            label: "the database after that, a claimed episode".into(),
            measured: format!("{:.1} bytes", stored as f64 / (LEASES * EPISODES) as f64),
            goal: String::new(),
            ratio: None,
        },
    ])
}

/// Builds the scenario of a group.
fn group_scenario(lease: &Lease, group: i64) -> anyhow::Result<Scenario> {
    let contains_group =
        |range: &&SeedRange| (range.first_group..range.first_group + range.groups).contains(&group);
    let range = lease.ranges.iter().flatten().find(contains_group);
    let range = range.ok_or_else(|| anyhow::anyhow!("no range holds group {group}"))?;
    let recipe = Recipe::from_json(&lease.recipes[range.recipe])?;
    let seed = range.seed + u64::try_from(group - range.first_group)?;
    Ok(Scenario::new(Arc::new(recipe), Seed::new(seed)?))
}

pub(crate) async fn prepare_claim(
    api: &ApiClient,
    run: &str,
    episodes: usize,
) -> anyhow::Result<PreparedClaim> {
    let request =
        LeaseRequest { form: LeaseForm::Columns, ttl_s: 3600, ..LeaseRequest::new(u32::try_from(episodes)?) };
    let response = api.post(&format!("/v1/runs/{run}/leases"), serde_json::to_value(request)?).await;
    let lease: Lease = response.parse().context("no lease")?;
    let scores: Vec<Vec<f32>> = lease
        .ranges
        .as_deref()
        .unwrap_or_default()
        .par_iter()
        .map(|range| {
            let recipe = Arc::new(Recipe::from_json(&lease.recipes[range.recipe])?);
            let score = |group| {
                let scenario = Scenario::new(Arc::clone(&recipe), Seed::new(range.seed + group)?);
                Ok::<_, anyhow::Error>(hold_score(&scenario))
            };
            (0..u64::try_from(range.groups)?).map(score).collect()
        })
        .collect::<anyhow::Result<_>>()?;
    let bytes: Vec<u8> = scores.concat().iter().flat_map(|score| score.to_le_bytes()).collect();
    let mut body = b"\x81\xa5score\xc6".to_vec();
    body.extend_from_slice(&(bytes.len() as u32).to_be_bytes());
    body.extend_from_slice(&bytes);
    Ok(PreparedClaim { lease, body })
}

/// Returns the score of holding, or 0 without a valid start.
fn hold_score(scenario: &Scenario) -> f32 {
    let width = scenario.task().action_space().dim();
    let mut log = ActionLog::new(width, env_core::log::Precision::F64);
    log.stopped = Some(env_core::StopReason::TooLate);
    env_core::rollout::replay(scenario, &log).map_or(0.0, |outcome| outcome.score as f32)
}

/// Sends a claim, then the audited logs; returns their number.
pub(crate) async fn claim_columns(
    api: &ApiClient,
    run: &str,
    PreparedClaim { lease, body }: &PreparedClaim,
) -> anyhow::Result<usize> {
    let path = format!("/v1/runs/{run}/leases/{}/columns", lease.lease);
    let response = api.request("POST", &path, "application/msgpack", body.clone()).await;
    let claim: ColumnClaim = response.parse().context("the claim was rejected")?;
    let mut results = Vec::new();
    for audited in &claim.audited_groups {
        let log = run_policy(&group_scenario(lease, audited.group)?, "hold").log;
        results.push(json!({"episode": audited.episodes[0], "actions": log_to_json(&log)}));
    }
    let audited = results.len();
    let report: ResultsResponse = serde_json::from_value(api.report(run, results).await)?;
    let is_audited = report.results.iter().all(|receipt| receipt.status == ReceiptStatus::Audited);
    anyhow::ensure!(is_audited, "an audit failed: {:?}", report.results);
    let claim: ColumnClaim = api.get(&path).await.parse()?;
    anyhow::ensure!(claim.state == ClaimState::Accepted, "not accepted: {claim:?}");
    Ok(audited)
}
