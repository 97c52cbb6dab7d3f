//! Repeated kills of a server lose no acknowledged result and count nothing twice.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by a panic; the report is visible with --nocapture"
)]

use std::path::Path;
use std::process::Command;

use curriculum::{Curriculum, CurriculumEvent};
use orchestrator::runs::settings::RunSettings;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Row};
use system_tests::crash::{CrashPlan, CrashReport, CrashWorld, StopCondition, run_crash_test};
use system_tests::{ServerProcess, is_long_test, sparring_binary, wait_until};

/// Runs a crash test of kessler with at least `kills` kills, or three times as many in long tests.
///
/// Trainers use TLS if the disk has faults. The environment variable `SPARRING_CRASH_SEED` sets the seed; the default is 7.
async fn crash(db: &Path, kills: u32, compacts: bool, faults: bool) -> CrashReport {
    // A run that compacts keeps several hundred episodes.
    let episodes = match (faults, compacts) {
        (true, _) => 30,
        (false, true) => 100,
        (false, false) => 50,
    };
    let times = if is_long_test() { 3 } else { 1 };
    let until = StopCondition::Kills { kills: times * kills, episodes };
    let plan = plan(CrashWorld::Kessler, until);
    // Servers that live shorter do less between the kills, but also less of what a fault or a compaction needs.
    let max_lifetime_ms = if faults || compacts || is_long_test() { plan.max_lifetime_ms } else { 1000 };
    run(db, CrashPlan { compacts, tls: faults, faults, max_lifetime_ms, ..plan }).await
}

/// A crash test of a world without faults, with short lives of the servers.
fn plan(world: CrashWorld, until: StopCondition) -> CrashPlan {
    let seed = std::env::var("SPARRING_CRASH_SEED").ok().and_then(|seed| seed.parse().ok()).unwrap_or(7);
    CrashPlan {
        world,
        until,
        seed,
        min_lifetime_ms: 50,
        max_lifetime_ms: 1500,
        compacts: false,
        tls: false,
        faults: false,
        workers: 0,
        trainer_pause_ms: 0,
        ends_on_signal: false,
        progress_interval_s: 0,
    }
}

/// Runs a crash test and checks the database with `sparring db check`.
async fn run(db: &Path, plan: CrashPlan) -> CrashReport {
    let report = match run_crash_test(db, plan).await {
        Ok(report) => report,
        Err(error) => panic!("seed {}: {error:#}", plan.seed),
    };
    println!("{report}"); // visible with: cargo test -p system-tests crash -- --nocapture

    // The database is intact and consistent, each log replays to its score, and the events lead to the stored curriculum.
    let check =
        Command::new(sparring_binary()).args(["db", "check", "--deep", "--db"]).arg(db).output().unwrap();
    assert_eq!(check.status.code(), Some(0), "{}", String::from_utf8_lossy(&check.stdout));
    report
}

#[tokio::test(flavor = "multi_thread")]
async fn kills_during_compaction_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("survivor.sqlite3");
    let report = crash(&db, 8, true, false).await;
    let mut conn = SqliteConnectOptions::new().filename(&db).read_only(true).connect().await.unwrap();
    // A further server compacts what the killed ones had no time for.
    let _server = ServerProcess::start(&db);
    wait_until(&format!("more than 200 episodes are compacted: {report}"), async || {
        let sql = "SELECT coalesce(sum(episodes), 0) FROM compacted_leases";
        sqlx::query_scalar::<_, i64>(sql).fetch_one(&mut conn).await.unwrap() > 200
    })
    .await;
}

#[cfg(target_os = "linux")]
#[tokio::test(flavor = "multi_thread")]
async fn kills_with_tls_and_faults_of_disk_and_lock_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    std::fs::create_dir(&data).unwrap();
    let report = crash(&data.join("survivor.sqlite3"), 16, true, true).await;
    assert!(report.kills >= 16 && report.vectors > 4, "{report}");
}

#[tokio::test(flavor = "multi_thread")]
async fn acknowledged_results_survive_kills_and_count_once() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("survivor.sqlite3");
    let report = crash(&db, 14, false, false).await;
    assert!(report.kills >= 12 && report.stops >= 2 && report.unreachable > 10, "{report}");
    assert_eq!(
        report.by_interface.keys().copied().collect::<Vec<_>>(),
        ["columns", "results", "steps", "trajectories"]
    );
    assert!(
        report.by_interface.values().all(|episodes| *episodes > 4)
            && report.acknowledged > 4
            && report.vectors > 4
            && report.resumed > 4,
        "{report}"
    );

    // A replay of all events leads to the stored snapshot, whichever snapshots the kills left in between.
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
        folded.replay_event(event.get::<i64, _>("seq").cast_unsigned(), &body).unwrap();
    }
    let stored: String =
        sqlx::query_scalar("SELECT body FROM curriculum_snapshots ORDER BY seq DESC LIMIT 1")
            .fetch_one(&mut conn)
            .await
            .unwrap();
    let stored: serde_json::Value = serde_json::from_str(&stored).unwrap();
    assert_eq!(serde_json::to_value(folded.snapshot()).unwrap(), stored);
}

#[tokio::test(flavor = "multi_thread")]
async fn kills_of_servers_workers_and_nats_lose_nothing() {
    if system_tests::nats_server::NatsServer::start().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let until = StopCondition::Kills { kills: 10, episodes: 20 };
    // Workers need a second or two to join again. Trainers that pause leave processors to other tests.
    let plan = CrashPlan {
        workers: 2,
        max_lifetime_ms: 5000,
        trainer_pause_ms: 600,
        ..plan(CrashWorld::Kessler, until)
    };
    let report = run(&folder.path().join("survivor.sqlite3"), plan).await;
    assert!(report.worker_kills >= 10 && report.nats_kills >= 4 && report.remote_jobs > 20, "{report}");
    assert!(report.remote_rollouts > 0 && !report.is_interrupted, "{report}");
    assert_eq!(report.by_interface.len(), 4, "{report}");
}

#[tokio::test(flavor = "multi_thread")]
async fn kills_under_tasking_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (kills, episodes) = if is_long_test() { (20, 8) } else { (8, 4) };
    let until = StopCondition::Kills { kills, episodes };
    let report = run(&folder.path().join("survivor.sqlite3"), plan(CrashWorld::ShortTasking, until)).await;
    assert!(report.kills >= kills && report.vectors > 1 && report.acknowledged > 1, "{report}");
    assert_eq!(report.by_interface.len(), 4, "{report}");
}
