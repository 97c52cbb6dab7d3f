//! A server that is killed again and again has lost nothing it acknowledged, and counts nothing twice.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that finds something else than it wants must fail; the ledger is for who asks for it"
)]

use std::path::Path;
use std::process::Command;

use curriculum::{Curriculum, CurriculumEvent};
use orchestrator::training::RunSettings;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Row};
use system_tests::binary;
use system_tests::survival::{Ledger, Plan, Until, survive};

/// Lets servers be killed so often; what came of it.
async fn survived(db: &Path, kills: u32, folds: bool) -> Ledger {
    let seed = std::env::var("SPARRING_SURVIVAL_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(7);
    let plan = Plan { until: Until::Kills(kills), seed, life_ms: (50, 1500), folds, told_every_s: 0 };
    let ledger = match survive(db, plan).await {
        Ok(ledger) => ledger,
        Err(error) => panic!("seed {seed}: {error:#}"),
    };
    println!("{ledger}"); // for who asks for it: cargo test --test survival -- --nocapture

    // The file is whole, agrees with itself, and every action that is sampled replays to its score.
    let check =
        Command::new(binary()).args(["db", "check", "--replay", "2000", "--db"]).arg(db).output().unwrap();
    assert_eq!(check.status.code(), Some(0), "{}", String::from_utf8_lossy(&check.stdout));
    ledger
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_lost_where_servers_are_killed_while_they_fold() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("survivor.sqlite3");
    let ledger = survived(&db, 12, true).await;
    let mut conn = SqliteConnectOptions::new().filename(&db).read_only(true).connect().await.unwrap();
    let folded: i64 =
        sqlx::query_scalar("SELECT sum(episodes) FROM folds").fetch_one(&mut conn).await.unwrap();
    assert!(folded > 200, "{folded} episodes were folded: {ledger}");
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_that_was_acknowledged_is_lost_or_counted_twice() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("survivor.sqlite3");
    let ledger = survived(&db, 22, false).await;
    assert!(ledger.kills >= 20 && ledger.stops >= 3 && ledger.away > 20, "{ledger}");
    assert_eq!(
        ledger.by_way.keys().copied().collect::<Vec<_>>(),
        ["columns", "results", "steps", "trajectories"]
    );
    assert!(ledger.by_way.values().all(|episodes| *episodes > 4) && ledger.acked > 4, "{ledger}");

    // The curriculum is what its events lead to from the first one on, whatever snapshots were taken on the way.
    let mut conn = SqliteConnectOptions::new().filename(&db).read_only(true).connect().await.unwrap();
    let run = sqlx::query("SELECT seed, settings FROM runs").fetch_one(&mut conn).await.unwrap();
    let settings: RunSettings = serde_json::from_str(run.get("settings")).unwrap();
    let mut folded = Curriculum::new(run.get::<i64, _>("seed").cast_unsigned(), settings.curriculum).unwrap();
    let events = sqlx::query("SELECT seq, body FROM curriculum_events ORDER BY seq")
        .fetch_all(&mut conn)
        .await
        .unwrap();
    for event in events {
        let body: CurriculumEvent = serde_json::from_str(event.get("body")).unwrap();
        folded.replay(event.get::<i64, _>("seq").cast_unsigned(), &body).unwrap();
    }
    let stored: String =
        sqlx::query_scalar("SELECT body FROM curriculum_snapshots ORDER BY seq DESC LIMIT 1")
            .fetch_one(&mut conn)
            .await
            .unwrap();
    let stored: serde_json::Value = serde_json::from_str(&stored).unwrap();
    assert_eq!(serde_json::to_value(folded.snapshot()).unwrap(), stored);
}
