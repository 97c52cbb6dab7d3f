//! A server that is killed again and again (each fifth time it is asked to stop) under trainers that come by every way in, and the ledger of what they were told.

mod book;
mod trainers;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use serde_json::{Value, json};
use tokio::task::JoinSet;

pub use self::book::{Book, Ledger};
use self::trainers::Trainer;
use crate::{Api, Process};

/// The run that all of it is about.
const RUN: &str = "survivor";

/// How often a server is killed.
#[derive(Debug, Clone, Copy)]
pub enum Until {
    /// So often.
    Kills(u32),
    /// As long as this lasts.
    Time(Duration),
}

/// How it is done.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    /// How often.
    pub until: Until,
    /// Seed of the moments at which it is killed.
    pub seed: u64,
    /// Shortest and longest life of a server, milliseconds after it answers.
    pub life_ms: (u64, u64),
    /// Whether little is kept whole, so that servers are killed while they fold, too.
    pub folds: bool,
    /// Each so many seconds a line on stderr; none if 0.
    pub told_every_s: u64,
}

/// Trains, kills, and starts again; then compares what trainers were told with what there is.
///
/// # Errors
/// What cannot go on, and a ledger that does not agree.
pub async fn survive(db: &Path, plan: Plan) -> anyhow::Result<Ledger> {
    let mut server = Process::start(db);
    let address = server.address().to_owned();
    prepare(&server.api(), plan).await?;

    let (book, over) = (Arc::new(Book::default()), Arc::new(AtomicBool::new(false)));
    let mut work = JoinSet::new();
    let trainer = |seed| Trainer::new(&server.api(), &book, &over, seed);
    work.spawn(trainer(1).results());
    work.spawn(trainer(2).results());
    work.spawn(trainer(3).columns());
    work.spawn(trainer(4).steps());
    work.spawn(trainer(5).steps());
    work.spawn(trainer(6).trajectories());

    let (mut kills, mut stops, begun, mut told) = (0u32, 0u32, Instant::now(), Instant::now());
    let more = |kills: u32| match plan.until {
        Until::Kills(most) => kills < most,
        Until::Time(most) => begun.elapsed() < most,
    };
    while more(kills) {
        let life = draw(plan.seed, kills + stops, plan.life_ms);
        tokio::select! {
            () = tokio::time::sleep(Duration::from_millis(life)) => {}
            Some(ended) = work.join_next() => {
                ended??;
                anyhow::bail!("a trainer ended before it was told to");
            }
        }
        if (kills + stops) % 5 == 4 {
            // As service managers ask, in the middle of everything.
            ensure!(
                server.terminate() == Some(0),
                "a server that was asked to stop did not do so in good order"
            );
            stops += 1;
        } else {
            server.kill();
            kills += 1;
        }
        server = Process::start_at(&address, db, &[]);
        if plan.told_every_s > 0 && told.elapsed() > Duration::from_secs(plan.told_every_s) {
            told = Instant::now();
            say(&format!("{:>6.0} s, {kills} kills: {}", begun.elapsed().as_secs_f64(), book.in_a_line()))?;
        }
    }
    over.store(true, Ordering::SeqCst);
    while let Some(ended) = work.join_next().await {
        ended??;
    }
    let ledger = settle(&server.api(), &book, (kills, stops)).await?;
    ensure!(server.terminate() == Some(0), "the last server did not stop in good order");
    Ok(ledger)
}

/// The run and the policy that it learns from: what trainers find.
async fn prepare(api: &Api, plan: Plan) -> anyhow::Result<()> {
    let retention = match plan.folds {
        true => json!({"episodes": 200, "claimed": 400}),
        false => json!({"episodes": "all", "claimed": "all"}),
    };
    let wish = json!({"id": RUN, "seed": plan.seed, "group_size": 2, "target": "mastery",
                      "tasks": ["kessler/survival", "kessler/eco_station"], "retention": retention});
    let created = api.post("/v1/runs", wish).await;
    ensure!(created.status == 201, "no run: {}", created.body);
    let policy = json!({"policy": "random", "version": 1, "ahead": 64}).to_string();
    let put = api.raw("PUT", &format!("/v1/runs/{RUN}/policy"), "application/json", policy).await;
    ensure!(put.status == 200, "no policy: {}", put.body);
    Ok(())
}

/// Waits until nothing goes on any more, then compares.
async fn settle(api: &Api, book: &Book, ends: (u32, u32)) -> anyhow::Result<Ledger> {
    let off = json!({"policy": "off"}).to_string();
    let put = api.raw("PUT", &format!("/v1/runs/{RUN}/policy"), "application/json", off).await;
    ensure!(put.status == 200, "the policy cannot be stopped: {}", put.body);
    for lease in all(api, "leases").await? {
        if lease["status"] == "active" {
            let path =
                format!("/v1/runs/{RUN}/leases/{}/release", lease["lease"].as_str().unwrap_or_default());
            let released = api.post(&path, json!({})).await;
            ensure!(released.status == 200, "{path}: {}", released.body);
        }
    }
    let begun = Instant::now();
    while api.get(&format!("/v1/runs/{RUN}")).await.body["critique"]["waiting"].as_i64().unwrap_or(1) > 0 {
        ensure!(begun.elapsed() < Duration::from_secs(120), "the critique does not come to its end");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    let groups = trainers::left(api, RUN).await?;
    let mastery = api.get(&format!("/v1/runs/{RUN}/mastery")).await.body;
    book.compare(ends, &all(api, "episodes").await?, &mastery, &groups)
}

/// All pages of a list of the run.
async fn all(api: &Api, what: &str) -> anyhow::Result<Vec<Value>> {
    let (mut found, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = api.get(&format!("/v1/runs/{RUN}/{what}?limit=500{cursor}")).await;
        ensure!(page.status == 200, "{what}: {}", page.body);
        found.extend(page.body[what].as_array().context("no list")?.clone());
        match page.body["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return Ok(found),
        }
    }
}

/// A number within bounds, the same for the same seed and place (SplitMix64: Steele, Lea and Flood 2014).
fn draw(seed: u64, place: u32, (low, high): (u64, u64)) -> u64 {
    let mut z = seed.wrapping_add(u64::from(place).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    low + (z ^ (z >> 31)) % (high - low + 1)
}

fn say(line: &str) -> std::io::Result<()> {
    use std::io::Write;
    writeln!(std::io::stderr(), "{line}")
}
