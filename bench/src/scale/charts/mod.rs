//! Charts of the dashboard at ten million episodes in a thousand runs: durations of their requests, warm and cold.

mod fill;

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use rustix::fs::{Advice, fadvise};
use system_tests::ApiClient;

use self::fill::{Database, LARGE_RUN};
use super::{GOAL_START_MS, goal_row, p99, start_server};
use crate::Row;

/// Goal of the 99th percentile of a request, in milliseconds.
const GOAL_MS: f64 = 100.0;
/// Number of small runs.
const RUNS: u32 = 1000;
/// Requests of each chart of a server that runs.
const WARM_REQUESTS: u32 = 300;
/// Starts of a server whose database is not in memory; each requests every chart once.
const COLD_STARTS: u32 = 25;
/// Distance between the runs of successive requests: a number without a divisor in common with most numbers of runs.
const STRIDE: u32 = 37;

/// Charts and lists of a run, which begin with its path.
const RUN_CHARTS: [&str; 12] = [
    "series?points=500&by=episodes",
    "series?points=500",
    "overview",
    "mastery",
    "params",
    "sampler",
    "level_moves?limit=500",
    "metrics?points=500",
    "failure_profiles?task=kessler/survival",
    "failures?task=kessler/survival&limit=500",
    "policy_versions?limit=100",
    "episodes?limit=100",
];
/// Lists of all runs.
const RUN_LISTS: [&str; 5] = [
    "/v1/runs?limit=100",
    "/v1/runs?limit=100&sort=skill&order=desc",
    "/v1/runs?limit=100&search=copy-77",
    "/v1/run_groups?by=strategy",
    "/v1/alerts",
];

/// Durations of a request in milliseconds.
struct ChartTimes {
    path: String,
    warm: Vec<f64>,
    cold: Vec<f64>,
}

pub(crate) fn measure(episodes: u64) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(episodes))
}

async fn run(episodes: u64) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("bench.sqlite3");
    let Database { episodes, bytes } = fill::fill(&file, episodes, RUNS).await?;
    let mut charts: Vec<ChartTimes> =
        paths().into_iter().map(|path| ChartTimes { path, warm: Vec::new(), cold: Vec::new() }).collect();
    let mut start_ms = Vec::new();
    for start in 0..COLD_STARTS {
        evict(&file)?;
        let (server, ms) = start_server(&file).await;
        start_ms.push(ms);
        for chart in &mut charts {
            evict(&file)?;
            chart.cold.push(request_ms(&server.api(), &chart.path, start * STRIDE % RUNS).await?);
        }
        anyhow::ensure!(server.terminate() == Some(0), "the server failed");
    }
    let (server, _) = start_server(&file).await;
    for chart in &mut charts {
        for number in 0..WARM_REQUESTS {
            chart.warm.push(request_ms(&server.api(), &chart.path, number * STRIDE % RUNS).await?);
        }
    }
    drop(server);
    let gib = bytes as f64 / f64::from(1 << 30);
    writeln!(std::io::stderr(), "{episodes} episodes in {RUNS} runs, {gib:.1} GiB")?;
    let start = p99(&mut start_ms);
    let label = format!("cold start with {episodes} episodes in {RUNS} runs ({gib:.1} GiB), the slowest");
    let mut rows = vec![goal_row(label, start, GOAL_START_MS)];
    for ChartTimes { path, mut warm, mut cold } in charts {
        rows.push(goal_row(format!("GET {path}, p99 of {WARM_REQUESTS}"), p99(&mut warm), GOAL_MS));
        rows.push(goal_row(format!("GET {path}, cold, slowest of {COLD_STARTS}"), p99(&mut cold), GOAL_MS));
    }
    Ok(rows)
}

/// Paths of all requests. `RUN` stands for the id of a run.
fn paths() -> Vec<String> {
    let of_run = |run: &str| RUN_CHARTS.map(|chart| format!("/v1/runs/{run}/{chart}"));
    let lists = RUN_LISTS.map(str::to_owned);
    [of_run("RUN").to_vec(), of_run(LARGE_RUN).to_vec(), lists.to_vec()].concat()
}

/// Requests a chart of the run with this number; returns the duration in milliseconds.
async fn request_ms(api: &ApiClient, path: &str, run: u32) -> anyhow::Result<f64> {
    let path = path.replace("RUN", &fill::run_id(run));
    let start = Instant::now();
    let response = api.get(&path).await;
    let ms = start.elapsed().as_secs_f64() * 1e3;
    anyhow::ensure!(response.status == 200, "{path}: {} {}", response.status, response.body);
    Ok(ms)
}

/// Removes the pages of the database from the cache of the operating system.
fn evict(file: &Path) -> anyhow::Result<()> {
    let file = std::fs::File::open(file)?;
    file.sync_all()?;
    Ok(fadvise(&file, 0, None, Advice::DontNeed)?)
}
