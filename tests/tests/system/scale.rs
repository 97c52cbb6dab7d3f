//! Many runs, many slow clients, and a backup of a database that trainers use. `make soak` measures the same with 10 000 runs,
//! 2 000 clients and 10 GiB.

use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use system_tests::scale::{ACTIVE_EVERY, create_runs, send_slowly};
use system_tests::{ApiClient, ServerProcess, sparring_binary, wait_until};
use tokio::task::JoinSet;

const RUNS: u32 = 200;
const SLOW_CLIENTS: u64 = 200;
/// Rows of filler in the database that is backed up, of 4 KiB each: more than the caches of the server.
const FILLER_ROWS: u32 = 30_000;

/// Number of runs in all pages of a list.
async fn count_runs(api: &ApiClient, query: &str) -> u32 {
    let (mut count, mut cursor) = (0, String::new());
    loop {
        let page = api.get(&format!("/v1/runs?limit=50{query}{cursor}")).await.expect(200);
        count += u32::try_from(page["runs"].as_array().unwrap().len()).unwrap();
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return count,
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn all_of_many_runs_are_listed_after_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let server = ServerProcess::start(&db);
    create_runs(&server.api(), RUNS).await.unwrap();
    server.kill();
    let server = ServerProcess::start(&db);
    let api = server.api();
    assert_eq!(count_runs(&api, "").await, RUNS / ACTIVE_EVERY);
    assert_eq!(count_runs(&api, "&archived=true").await, RUNS - RUNS / ACTIVE_EVERY);
    for run in [0, RUNS - 1] {
        for view in ["overview", "mastery"] {
            let _ = api.get(&format!("/v1/runs/run-{run}/{view}")).await.expect(200);
        }
    }
    let _ = api.lease("run-0", json!({"groups": 1})).await;
}

/// Leases and reports; returns the statuses of the receipts.
async fn train(api: &ApiClient, run: &str, leases: usize) -> Vec<Value> {
    let mut statuses = Vec::new();
    for _ in 0..leases {
        let lease = api.lease(run, json!({"groups": 4})).await;
        let receipts = api.report(run, lease.results("hold")).await;
        statuses
            .extend(receipts["results"].as_array().unwrap().iter().map(|receipt| receipt["status"].clone()));
    }
    statuses
}

async fn create_run(api: &ApiClient) {
    let settings = json!({"strategy": "ladder", "id": "run", "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
}

#[cfg(target_os = "linux")]
#[tokio::test(flavor = "multi_thread")]
async fn slow_connections_cost_little_and_stop_no_trainer() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let api = server.api();
    create_run(&api).await;
    let before = train(&api, "run", 4).await;
    let memory_mib = server.resident_mib();
    let (opened, closed) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let mut slow = JoinSet::new();
    for _ in 0..SLOW_CLIENTS {
        let (address, opened, closed) =
            (server.address().to_owned(), Arc::clone(&opened), Arc::clone(&closed));
        slow.spawn(async move { send_slowly(address, &opened, &closed).await });
    }
    wait_until("all connections are open", async || opened.load(Ordering::Relaxed) >= SLOW_CLIENTS).await;
    assert_eq!(train(&api, "run", 4).await, before, "all results are counted");
    assert_eq!(api.get("/livez").await.status, 200);
    let grown_mib = server.resident_mib().saturating_sub(memory_mib);
    assert!(grown_mib < 100, "{SLOW_CLIENTS} connections took {grown_mib} MiB");
}

async fn execute(db: &std::path::Path, statement: String) {
    let mut conn = SqliteConnectOptions::new()
        .filename(db)
        .busy_timeout(Duration::from_secs(60))
        .connect()
        .await
        .unwrap();
    sqlx::query(sqlx::AssertSqlSafe(statement)).execute(&mut conn).await.unwrap();
    conn.close().await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn backup_of_a_busy_database_is_consistent_and_vacuum_frees_space() {
    let folder = tempfile::tempdir().unwrap();
    let (db, copy) = (folder.path().join("db.sqlite3"), folder.path().join("copy.sqlite3"));
    let server = ServerProcess::start(&db);
    let api = server.api();
    create_run(&api).await;
    let filler = format!(
        "WITH RECURSIVE rows (value) AS (SELECT 1 UNION ALL SELECT value + 1 FROM rows WHERE value < {FILLER_ROWS})
         INSERT INTO audit_log (at, operation, path, status, request_id)
         SELECT 0, 'GET /', hex(randomblob(2000)), 200, hex(randomblob(16)) FROM rows"
    );
    execute(&db, filler).await;
    let acknowledged = train(&api, "run", 2).await.len();
    let (from, to) = (db.clone(), copy.clone());
    let backup = tokio::task::spawn_blocking(move || {
        Command::new(sparring_binary()).args(["db", "backup"]).arg(to).arg("--db").arg(from).output().unwrap()
    });
    let mut during = 0;
    while !backup.is_finished() {
        during += train(&api, "run", 1).await.len();
    }
    let backup = backup.await.unwrap();
    assert_eq!(backup.status.code(), Some(0), "{}", String::from_utf8_lossy(&backup.stderr));
    assert!(during > 0, "trainers work during the backup");
    assert_eq!(server.terminate(), Some(0));

    let full_bytes = std::fs::metadata(&db).unwrap().len();
    execute(&db, "DELETE FROM audit_log WHERE at = 0".to_owned()).await;
    let sparring = |args: &[&str], db: &std::path::Path| {
        let output =
            Command::new(sparring_binary()).arg("db").args(args).arg("--db").arg(db).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{args:?}: {output:?}");
    };
    sparring(&["vacuum"], &db);
    assert!(std::fs::metadata(&db).unwrap().len() < full_bytes / 4, "vacuum returns the space");
    sparring(&["check", "--deep"], &db);
    sparring(&["check", "--deep"], &copy);
    let server = ServerProcess::start(&copy);
    let stored = server.api().get("/v1/runs/run/episodes?limit=500").await.expect(200);
    let stored = stored["episodes"].as_array().unwrap().len();
    assert!((acknowledged..=acknowledged + during).contains(&stored), "{acknowledged} + {during}: {stored}");
}
