//! Ten thousand runs in one database: time to list them, and to start a server.

use std::io::Write;
use std::time::Instant;

use system_tests::ServerProcess;
use system_tests::scale::create_runs;

use super::{GOAL_START_MS, goal_row, median_ms, start_server};
use crate::Row;
use crate::sockets::process;

/// Goal of a request, in milliseconds.
const GOAL_REQUEST_MS: f64 = 50.0;

pub(crate) fn measure(runs: u32) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(runs))
}

async fn run(runs: u32) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("bench.sqlite3");
    let server = ServerProcess::start(&file);
    let start = Instant::now();
    create_runs(&server.api(), runs).await?;
    let seconds = start.elapsed().as_secs_f64();
    writeln!(std::io::stderr(), "{runs} runs created and archived in {seconds:.0} s")?;
    server.kill();
    let (server, start_ms) = start_server(&file).await;
    let api = server.api();
    let mut rows = vec![goal_row(format!("start with {runs} runs, until ready"), start_ms, GOAL_START_MS)];
    let active = "/v1/runs?limit=100";
    let archived = "/v1/runs?archived=true&limit=100";
    let sorted = "/v1/runs?archived=true&limit=100&sort=skill&order=desc";
    let searched = "/v1/runs?archived=true&limit=100&sort=name&search=run-77";
    let groups = "/v1/run_groups?by=strategy&archived=true";
    let run = ["/v1/runs/run-0/overview", "/v1/runs/run-0/mastery", "/metrics", "/readyz"];
    for path in [active, archived, sorted, searched, groups].into_iter().chain(run) {
        rows.push(goal_row(format!("GET {path}"), median_ms(&api, path).await?, GOAL_REQUEST_MS));
    }
    let mib = process::resident_bytes(server.pid())? as f64 / f64::from(1 << 20);
    rows.push(Row {
        label: format!("memory of the server with {runs} runs"),
        measured: format!("{mib:.0} MiB"),
        goal: String::new(),
        ratio: None,
    });
    Ok(rows)
}
