//! Scale of a server: many runs, many slow connections, a large database, charts of many long runs.

pub(crate) mod charts;
pub(crate) mod large_database;
pub(crate) mod many_runs;
pub(crate) mod slow_clients;

use std::path::Path;
use std::time::Instant;

use system_tests::{ApiClient, ServerProcess};

use crate::Row;

/// Goal of the start of a server, in milliseconds.
const GOAL_START_MS: f64 = 2000.0;
/// Number of requests of a list; their median counts.
const REQUESTS: usize = 5;

/// Median duration of a GET request, milliseconds.
async fn median_ms(api: &ApiClient, path: &str) -> anyhow::Result<f64> {
    let mut times = Vec::with_capacity(REQUESTS);
    for _ in 0..REQUESTS {
        let start = Instant::now();
        let response = api.get(path).await;
        anyhow::ensure!(response.status == 200, "{path}: {} {}", response.status, response.body);
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[REQUESTS / 2])
}

/// Starts a server on a database; returns it with the milliseconds until it was ready.
async fn start_server(file: &Path) -> (ServerProcess, f64) {
    let start = Instant::now();
    let server = ServerProcess::start(file);
    let api = server.api();
    while api.get("/readyz").await.status != 200 {}
    (server, start.elapsed().as_secs_f64() * 1e3)
}

/// Row of a duration, in milliseconds, and its goal.
fn goal_row(label: String, ms: f64, goal: f64) -> Row {
    Row { label, measured: format!("{ms:.1} ms"), goal: format!("≤ {goal:.0} ms"), ratio: Some(goal / ms) }
}

/// The 99th percentile of some times; the slowest of fewer than a hundred. It sorts them.
fn p99(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times.get(times.len() * 99 / 100).copied().unwrap_or(f64::NAN)
}
