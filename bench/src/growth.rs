//! Growth of a long run: size of the database and duration of list requests, after up to ten million episodes.

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use serde_json::json;
use system_tests::{ApiClient, ServerProcess};

use crate::Row;
use crate::report_episodes::report_episodes;

/// Number of rows of the table.
const ROWS: u64 = 10;
/// Number of requests of each list; their median counts.
const REQUESTS: usize = 5;

/// Goal of the size of the database after 10⁷ episodes, in bytes.
const GOAL_BYTES: f64 = (1u64 << 30) as f64;
/// Goal of the slowest list request, in milliseconds.
const GOAL_MS: f64 = 50.0;

pub(crate) fn measure(episodes: u64, group_size: u32) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(episodes, group_size))
}

async fn run(episodes: u64, group_size: u32) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("bench.sqlite3");
    let server = ServerProcess::start(&file);
    let api = server.api();
    // All settings have defaults, except the group size and the task, which is the fastest to prepare.
    let settings = json!({"strategy": "ladder", "id": "bench", "seed": 1, "group_size": group_size, "tasks": ["kessler/survival"]});
    let created = api.post("/v1/runs", settings).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    let (mut rows, mut done, start) = (Vec::new(), 0, Instant::now());
    let (mut bytes, mut slowest) = (0.0f64, 0.0f64);
    for line in 1..=ROWS {
        done += report_episodes(&api, "bench", episodes * line / ROWS - done).await?;
        let lists = measure_lists(&api).await?;
        bytes = database_and_wal_bytes(&file)?;
        let (name, ms) = lists.iter().max_by(|a, b| a.1.total_cmp(&b.1)).cloned().unwrap_or_default();
        slowest = slowest.max(ms);
        let all: Vec<String> = lists.iter().map(|(name, ms)| format!("{name} {ms:.0}")).collect();
        writeln!(
            std::io::stderr(),
            "{done:>9} episodes, {:>6.0} s: {:>6.0} MiB; ms: {}",
            start.elapsed().as_secs_f64(),
            bytes / f64::from(1 << 20),
            all.join(", ")
        )?;
        rows.push(Row {
            label: format!("the database after {done} episodes in groups of {group_size}"),
            measured: format!("{:.0} MiB; {name} {ms:.0} ms", bytes / f64::from(1 << 20)),
            goal: "≤ 1024 MiB; < 50 ms".into(),
            ratio: Some((GOAL_BYTES / bytes).min(GOAL_MS / ms)),
        });
    }
    drop(server);
    rows.push(Row {
        label: "the database at the end, and the slowest list request".into(),
        measured: format!("{:.0} MiB; {slowest:.0} ms", bytes / f64::from(1 << 20)),
        goal: "≤ 1024 MiB; < 50 ms".into(),
        ratio: Some((GOAL_BYTES / bytes).min(GOAL_MS / slowest)),
    });
    Ok(rows)
}

/// Measures list requests of a run, at the start and at the end of long lists; returns names and milliseconds.
async fn measure_lists(api: &ApiClient) -> anyhow::Result<Vec<(String, f64)>> {
    let last = api.lease("bench", json!({"groups": 1, "ttl_s": 60})).await;
    let number: i64 = last.id().split('-').next().and_then(|text| text.parse().ok()).unwrap_or(i64::MAX);
    let mut times = Vec::new();
    for (name, path) in [
        ("runs", "/v1/runs?limit=500".to_owned()),
        ("episodes", "/v1/runs/bench/episodes?limit=500".to_owned()),
        ("middle", format!("/v1/runs/bench/episodes?limit=500&cursor={}.0", number / 2)),
        ("newest", format!("/v1/runs/bench/episodes?limit=500&cursor={}.0", (number - 20).max(0))),
        ("leases", "/v1/runs/bench/leases?limit=500".to_owned()),
        ("last leases", format!("/v1/runs/bench/leases?limit=500&cursor={}.", (number - 500).max(0))),
        ("mastery", "/v1/runs/bench/mastery".to_owned()),
        ("history", "/v1/runs/bench/level_moves".to_owned()),
        ("failures", "/v1/runs/bench/failures?limit=500&task=kessler/survival".to_owned()),
        ("designs", "/v1/runs/bench/designs?limit=500".to_owned()),
    ] {
        let mut durations = Vec::new();
        for _ in 0..REQUESTS {
            let start = Instant::now();
            let response = api.get(&path).await;
            durations.push(start.elapsed().as_secs_f64() * 1e3);
            anyhow::ensure!(response.status == 200, "{path}: {}", response.body);
        }
        durations.sort_by(f64::total_cmp);
        times.push((name.to_owned(), durations[REQUESTS / 2]));
    }
    Ok(times)
}

/// Returns the size of the database with its write-ahead log, in bytes.
fn database_and_wal_bytes(file: &Path) -> anyhow::Result<f64> {
    let log = file.with_extension("sqlite3-wal");
    let size = |file: &Path| std::fs::metadata(file).map_or(0, |meta| meta.len());
    Ok((size(file) + size(&log)) as f64)
}
