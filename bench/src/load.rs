//! Sixty-four trainers at once for some minutes, each with a lease, its results and the next: how long they wait, and what the
//! server's memory does meanwhile.

use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use system_tests::{Api, Lease, Process, result};
use tokio::task::JoinSet;

use crate::Row;
use crate::sockets::process;

const TRAINERS: usize = 64;
/// Groups of a lease, and episodes of a group.
const GROUPS: u32 = 2;
const GROUP_SIZE: u32 = 4;
/// What a trainer does between two leases beside flying: it learns.
const LEARNS: Duration = Duration::from_millis(500);
/// Memory at the end over that of the second minute, at most.
const FLAT: f64 = 1.15;

/// Milliseconds that requests took, by kind.
#[derive(Default)]
struct Times {
    leases: Vec<f64>,
    results: Vec<f64>,
    /// Episodes that counted.
    counted: u64,
    /// Answers that ask to come again.
    busy: u64,
}

type Shared = Arc<Mutex<Times>>;

pub(crate) fn measure(minutes: u32) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(minutes.max(2)))
}

async fn run(minutes: u32) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let server = Process::start(&folder.path().join("bench.sqlite3"));
    let api = server.api();
    let wish = json!({"id": "load", "seed": 1, "group_size": GROUP_SIZE});
    let created = api.post("/v1/runs", wish).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    let times = Shared::default();
    let mut trainers = JoinSet::new();
    for _ in 0..TRAINERS {
        trainers.spawn(train(Api::new(api.base()), Arc::clone(&times)));
    }
    let (begun, mut memory) = (Instant::now(), Vec::new());
    for minute in 1..=minutes {
        tokio::select! {
            () = tokio::time::sleep_until((begun + Duration::from_secs(60) * minute).into()) => {}
            Some(ended) = trainers.join_next() => match ended? {
                Ok(never) => match never {},
                Err(error) => return Err(error),
            },
        }
        let mib = process::resident(server.pid())? as f64 / f64::from(1 << 20);
        memory.push(mib);
        writeln!(std::io::stderr(), "minute {minute}: {mib:.0} MiB")?;
    }
    trainers.shutdown().await;
    let mut times = times.lock().unwrap_or_else(PoisonError::into_inner);
    let counted = times.counted as f64 / begun.elapsed().as_secs_f64();
    let busy = times.busy;
    let growth = memory[memory.len() - 1] / memory[1];
    let told: Vec<String> = memory.iter().map(|mib| format!("{mib:.0}")).collect();
    let row = |what: String, measured: String| Row { what, measured, goal: String::new(), ratio: None };
    Ok(vec![
        row(
            format!(
                "{TRAINERS} trainers for {minutes} minutes, leases of {GROUPS} groups of {GROUP_SIZE}, flown here"
            ),
            format!("{counted:.0} episodes/s; {busy} asked again"),
        ),
        row("a lease".into(), quantiles(&mut times.leases)),
        row("its results, replayed and on disk".into(), quantiles(&mut times.results)),
        Row {
            what: format!("memory of the server, MiB a minute: {}", told.join(" ")),
            measured: format!("{growth:.2} of minute 2"),
            goal: format!("≤ {FLAT}"),
            ratio: Some(FLAT / growth),
        },
    ])
}

fn quantiles(times: &mut [f64]) -> String {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times.get((times.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    format!("{:.1} ms median, {:.1} p99 of {}", at(0.5), at(0.99), times.len())
}

async fn train(api: Api, times: Shared) -> anyhow::Result<std::convert::Infallible> {
    loop {
        let lease = Lease(ask(&api, &times, "leases", &json!({"groups": GROUPS, "ttl_s": 600})).await?);
        let results = tokio::task::spawn_blocking(move || {
            let flown = lease.episodes().into_iter().map(|(id, scenario)| result(&id, &scenario, "hold"));
            flown.collect::<Vec<Value>>()
        });
        let told = ask(&api, &times, "results", &json!({"results": results.await?})).await?;
        let counted = told["results"].as_array().map_or(0, |all| {
            all.iter().filter(|told| matches!(told["status"].as_str(), Some("counted" | "stored"))).count()
        });
        times.lock().unwrap_or_else(PoisonError::into_inner).counted += counted as u64;
        tokio::time::sleep(LEARNS).await;
    }
}

/// Asks until it is granted; how long each answer took is noted.
async fn ask(api: &Api, times: &Shared, what: &str, body: &Value) -> anyhow::Result<Value> {
    loop {
        let begun = Instant::now();
        let answer = api.post(&format!("/v1/runs/load/{what}"), body.clone()).await;
        let ms = begun.elapsed().as_secs_f64() * 1e3;
        let again = {
            let mut times = times.lock().unwrap_or_else(PoisonError::into_inner);
            if what == "leases" {
                times.leases.push(ms);
            } else {
                times.results.push(ms);
            }
            let again = matches!(answer.status, 429 | 503);
            times.busy += u64::from(again);
            again
        };
        if !again {
            anyhow::ensure!(matches!(answer.status, 200 | 201), "{what}: {} {}", answer.status, answer.body);
            return Ok(answer.body);
        }
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}
