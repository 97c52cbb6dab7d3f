//! Ten thousand runs in one database: time to list them, and to start a server.

use std::io::Write;
use std::time::Instant;

use serde_json::json;
use system_tests::{ApiClient, ServerProcess};
use tokio::task::JoinSet;

use super::{GOAL_START_MS, goal_row, median_ms, start_server};
use crate::Row;
use crate::sockets::process;

/// Clients that create runs at a time.
const CLIENTS: u32 = 8;
/// One run in so many stays active; the others are archived.
const ACTIVE_EVERY: u32 = 10;
/// Largest number of runs that one request archives.
const ARCHIVED_AT_ONCE: usize = 1000;
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
    let mut clients: JoinSet<anyhow::Result<()>> = JoinSet::new();
    for client in 0..CLIENTS {
        clients.spawn(create_runs(server.api(), (client..runs).step_by(CLIENTS as usize).collect()));
    }
    while let Some(created) = clients.join_next().await {
        created??;
    }
    let seconds = start.elapsed().as_secs_f64();
    writeln!(std::io::stderr(), "{runs} runs created and archived in {seconds:.0} s")?;
    server.kill();
    let (server, start_ms) = start_server(&file).await;
    let api = server.api();
    let mut rows = vec![goal_row(format!("start with {runs} runs, until ready"), start_ms, GOAL_START_MS)];
    let active = "/v1/runs?limit=100";
    let archived = "/v1/runs?archived=true&limit=100";
    for path in [active, archived, "/v1/runs/run-0/overview", "/v1/runs/run-0/mastery", "/metrics", "/readyz"]
    {
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

/// Creates runs, and archives all but a share of them.
async fn create_runs(api: ApiClient, numbers: Vec<u32>) -> anyhow::Result<()> {
    let mut finished = Vec::new();
    for number in numbers {
        let id = format!("run-{number}");
        let settings = json!({"id": id, "tasks": ["kessler/survival"], "design": {"designer": "off"}});
        let created = api.post("/v1/runs", settings).await;
        anyhow::ensure!(created.status == 201, "no run: {}", created.body);
        if number % ACTIVE_EVERY != 0 {
            finished.push(id);
        }
        // Archived runs prepare no scenarios, which would take longer than the rest.
        if finished.len() == 16 {
            archive(&api, &std::mem::take(&mut finished)).await?;
        }
    }
    for part in finished.chunks(ARCHIVED_AT_ONCE) {
        archive(&api, part).await?;
    }
    Ok(())
}

async fn archive(api: &ApiClient, runs: &[String]) -> anyhow::Result<()> {
    let archived = api.post("/v1/archive", json!({"runs": runs})).await;
    anyhow::ensure!(archived.status == 200, "not archived: {}", archived.body);
    Ok(())
}
