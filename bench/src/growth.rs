//! A run of weeks in an hour: what its database comes to, and how long lists of it take.

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use serde_json::json;
use system_tests::{Api, Process};
use tokio::task::JoinSet;

use crate::{Row, results};

/// Trainers that report at the same time.
const TRAINERS: usize = 3;
/// Lines of the table.
const LINES: u64 = 10;
/// Times that each list is asked for.
const ASKED: usize = 5;

/// Bytes that 10⁷ episodes may take, and milliseconds that a list of them may.
const MOST_BYTES: f64 = (1u64 << 30) as f64;
const MOST_MS: f64 = 50.0;

pub(crate) fn measure(episodes: u64, group_size: u32) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(episodes, group_size))
}

async fn run(episodes: u64, group_size: u32) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("bench.sqlite3");
    let server = Process::start(&file);
    let api = server.api();
    // Everything at its defaults but the number of episodes of a scenario, and the task: the one that is prepared soonest.
    let wish = json!({"id": "bench", "seed": 1, "group_size": group_size, "tasks": ["kessler/survival"]});
    let created = api.post("/v1/runs", wish).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    let (mut rows, mut done, begun) = (Vec::new(), 0, Instant::now());
    let (mut bytes, mut slowest) = (0.0f64, 0.0f64);
    for line in 1..=LINES {
        done += report(&api, episodes * line / LINES - done).await?;
        let lists = lists(&api).await?;
        bytes = on_disk(&file)?;
        let (name, ms) = lists.iter().max_by(|a, b| a.1.total_cmp(&b.1)).cloned().unwrap_or_default();
        slowest = slowest.max(ms);
        let all: Vec<String> = lists.iter().map(|(name, ms)| format!("{name} {ms:.0}")).collect();
        writeln!(
            std::io::stderr(),
            "{done:>9} episodes, {:>6.0} s: {:>6.0} MiB; ms: {}",
            begun.elapsed().as_secs_f64(),
            bytes / f64::from(1 << 20),
            all.join(", ")
        )?;
        rows.push(Row {
            what: format!("the database after {done} episodes in groups of {group_size}"),
            measured: format!("{:.0} MiB; {name} {ms:.0} ms", bytes / f64::from(1 << 20)),
            goal: "≤ 1024 MiB; < 50 ms".into(),
            ratio: Some((MOST_BYTES / bytes).min(MOST_MS / ms)),
        });
    }
    drop(server);
    rows.push(Row {
        what: "the database at the end, the slowest list of all".into(),
        measured: format!("{:.0} MiB; {slowest:.0} ms", bytes / f64::from(1 << 20)),
        goal: "≤ 1024 MiB; < 50 ms".into(),
        ratio: Some((MOST_BYTES / bytes).min(MOST_MS / slowest)),
    });
    Ok(rows)
}

/// Reports at least so many episodes.
async fn report(api: &Api, episodes: u64) -> anyhow::Result<u64> {
    let mut trainers: JoinSet<anyhow::Result<u64>> = JoinSet::new();
    for _ in 0..TRAINERS {
        let api = api.clone();
        trainers.spawn(async move {
            let mut done = 0;
            while done < episodes / TRAINERS as u64 {
                for body in results::prepared(&api, "bench").await? {
                    done += results::send(&api, "bench", body).await?;
                }
            }
            Ok(done)
        });
    }
    let mut done = 0;
    while let Some(trainer) = trainers.join_next().await {
        done += trainer??;
    }
    Ok(done)
}

/// The lists of a run: at their beginning, and at their end.
async fn lists(api: &Api) -> anyhow::Result<Vec<(String, f64)>> {
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
        ("history", "/v1/runs/bench/mastery/history".to_owned()),
        ("failures", "/v1/runs/bench/failures/list?limit=500&task=kessler/survival".to_owned()),
        ("designs", "/v1/runs/bench/designs?limit=500".to_owned()),
    ] {
        let mut of_one = Vec::new();
        for _ in 0..ASKED {
            let start = Instant::now();
            let answer = api.get(&path).await;
            of_one.push(start.elapsed().as_secs_f64() * 1e3);
            anyhow::ensure!(answer.status == 200, "{path}: {}", answer.body);
        }
        of_one.sort_by(f64::total_cmp);
        times.push((name.to_owned(), of_one[ASKED / 2]));
    }
    Ok(times)
}

/// Bytes of the database and what is still to be folded into it.
fn on_disk(file: &Path) -> anyhow::Result<f64> {
    let log = file.with_extension("sqlite3-wal");
    let size = |file: &Path| std::fs::metadata(file).map_or(0, |meta| meta.len());
    Ok((size(file) + size(&log)) as f64)
}
