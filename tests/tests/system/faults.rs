//! Faults of disk and clock: full, failing and slow disk, locked database, clock jumps. The server reports the state, loses
//! nothing, and recovers by itself. `system_tests::faults` makes system calls of a real server fail.

#![cfg(target_os = "linux")]

mod clock;
mod damage;
mod disk;
mod full_disk;
mod locked;
mod remount;

use std::path::PathBuf;
use std::process::{Command, Stdio};

use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::faults::{EIO, ENOSPC, Fault, FaultControl};
use system_tests::{ApiClient, ApiResponse, ServerProcess, sparring_binary, wait_until};

const DAY_MS: i64 = 86_400_000;

/// Server whose disk and clock fail on demand.
struct FaultyServer {
    process: ServerProcess,
    folder: tempfile::TempDir,
    faults: FaultControl,
}

impl FaultyServer {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        // Faults concern the files in the folder of the database; the control file is outside of it.
        std::fs::create_dir(folder.path().join("data")).unwrap();
        let faults = FaultControl::create(folder.path());
        let command = faults.serve_command("127.0.0.1:0", &folder.path().join("data/db.sqlite3"));
        Self { process: ServerProcess::spawn(command, Stdio::null()), folder, faults }
    }

    /// Kills the server and starts another one on its database.
    fn restart(self) -> Self {
        let command = self.faults.serve_command("127.0.0.1:0", &self.db());
        let Self { process, folder, faults } = self;
        process.kill();
        Self { process: ServerProcess::spawn(command, Stdio::null()), folder, faults }
    }

    fn api(&self) -> ApiClient {
        self.process.api()
    }

    fn db(&self) -> PathBuf {
        self.folder.path().join("data/db.sqlite3")
    }

    fn get(&self, fault: Fault) -> i64 {
        self.faults.get(fault)
    }

    fn set(&self, fault: Fault, value: i64) {
        self.faults.set(fault, value);
    }

    /// Stops the server and checks its database.
    async fn stop_and_check(self) {
        let exit = tokio::task::spawn_blocking(move || {
            let (db, Self { process, folder, .. }) = (self.db(), self);
            assert_eq!(process.terminate(), Some(0));
            let check =
                Command::new(sparring_binary()).args(["db", "check", "--db"]).arg(db).output().unwrap();
            drop(folder);
            (check.status.code(), String::from_utf8(check.stdout).unwrap())
        });
        let (code, stdout) = exit.await.unwrap();
        assert_eq!(code, Some(0), "{stdout}");
    }
}

async fn start_run(api: &ApiClient) -> (Vec<Value>, Value) {
    let settings =
        json!({"id": "run", "seed": 3, "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let lease = api.lease("run", json!({"groups": 8})).await;
    let results = lease.results("hold");
    (results, lease.0)
}

async fn report(api: &ApiClient, results: &[Value]) -> ApiResponse {
    api.post("/v1/runs/run/results", json!({"results": results})).await
}

async fn stored_episodes(api: &ApiClient) -> usize {
    api.get("/v1/runs/run/episodes?limit=500").await.expect(200)["episodes"].as_array().unwrap().len()
}

/// Waits until the server is ready again.
async fn wait_until_ready(api: &ApiClient) {
    wait_until("the server is ready again", async || api.get("/readyz").await.status == 200).await;
}

/// Checks that the server rejects writes with the reason while the fault lasts, serves reads, and recovers afterwards.
async fn assert_recovery(fault: Fault, number: i64, reason: &str) {
    let server = FaultyServer::start();
    let api = server.api();
    let (results, _) = start_run(&api).await;
    let _ = report(&api, &results[..3]).await.expect(200);
    server.set(fault, number);
    for _ in 0..3 {
        let rejected = report(&api, &results[3..6]).await;
        assert_eq!(rejected.status, 503, "{}", rejected.body);
        assert_eq!(rejected.content_type, "application/problem+json");
        assert!(rejected.body["detail"].as_str().unwrap().contains(reason), "{}", rejected.body);
        assert!(rejected.retry_after.is_some());
        let lease = api.post("/v1/runs/run/leases", json!({"groups": 1})).await;
        assert_eq!(lease.status, 503, "{}", lease.body);
    }
    let ready_now = api.get("/readyz").await;
    assert_eq!(ready_now.status, 503);
    assert!(ready_now.body["detail"].as_str().unwrap().contains(reason), "{}", ready_now.body);
    assert_eq!(api.get("/livez").await.status, 200);
    assert_eq!(stored_episodes(&api).await, 3, "exactly the acknowledged results are stored");
    let metrics = api.get("/metrics").await;
    let metrics = metrics.body.as_str().unwrap();
    assert!(metrics.contains("sparring_writable 0"), "{metrics}");
    server.set(fault, 0);
    wait_until_ready(&api).await;
    let receipts = report(&api, &results).await.expect(200);
    let statuses: Vec<&str> =
        receipts["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect();
    assert_eq!(
        statuses,
        ["duplicate", "duplicate", "duplicate", "counted", "counted", "counted", "counted", "counted"]
    );
    let _ = api.lease("run", json!({"groups": 2})).await;
    assert_eq!(stored_episodes(&api).await, 8);
    server.stop_and_check().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn full_disk_is_reported_and_recovered() {
    assert_recovery(Fault::Write, ENOSPC, "the disk is full").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn failing_disk_is_reported_and_recovered() {
    assert_recovery(Fault::Write, EIO, "the disk failed").await;
    assert_recovery(Fault::Sync, EIO, "the disk failed").await;
}

/// Number of commits that took longer than 0.2 s since the start of the server.
async fn slow_commits(api: &ApiClient) -> u64 {
    let metrics = api.get("/metrics").await;
    let count = |name: &str| -> u64 {
        let lines = metrics.body.as_str().unwrap().lines();
        let value = lines.filter_map(|line| line.strip_prefix(name)?.trim().parse().ok()).next();
        value.unwrap_or_else(|| panic!("no metric {name}"))
    };
    count("sparring_commit_seconds_count") - count(r#"sparring_commit_seconds_bucket{le="0.2"}"#)
}

#[tokio::test(flavor = "multi_thread")]
async fn slow_disk_shares_commits() {
    let server = FaultyServer::start();
    let api = server.api();
    let (results, _) = start_run(&api).await;
    server.set(Fault::SlowSyncMs, 400);
    let commits_before = slow_commits(&api).await;
    let receipts = futures_util::future::join_all((0..40).map(|at| {
        let (api, one) = (api.clone(), vec![results[at % 8].clone()]);
        async move { report(&api, &one).await.expect(200) }
    }))
    .await;
    // Forty reports share commits: while the disk is busy with one commit, the next reports wait for the one after it.
    let commits = slow_commits(&api).await - commits_before;
    assert!((1..20).contains(&commits), "{commits} commits for 40 reports");
    let counted = receipts.iter().filter(|receipt| receipt["results"][0]["status"] == "counted").count();
    assert_eq!((counted, stored_episodes(&api).await), (8, 8));
    assert_eq!(api.get("/readyz").await.status, 200, "the server is ready on a slow disk");
    server.set(Fault::SlowSyncMs, 0);
    server.stop_and_check().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn locked_database_is_reported_and_recovered() {
    let server = FaultyServer::start();
    let api = server.api();
    let (results, _) = start_run(&api).await;
    let mut other = SqliteConnectOptions::new().filename(server.db()).connect().await.unwrap();
    sqlx::query("BEGIN IMMEDIATE").execute(&mut other).await.unwrap();
    let rejected = report(&api, &results[..2]).await;
    assert_eq!(rejected.status, 503, "{}", rejected.body);
    assert!(
        rejected.body["detail"].as_str().unwrap().contains("another process holds the database"),
        "{}",
        rejected.body
    );
    assert!(api.get("/readyz").await.body["detail"].as_str().unwrap().contains("another process holds"));
    assert_eq!(stored_episodes(&api).await, 0, "the database can be read");
    sqlx::query("ROLLBACK").execute(&mut other).await.unwrap();
    drop(other);
    wait_until_ready(&api).await;
    let receipts = report(&api, &results).await.expect(200);
    assert!(receipts["results"].as_array().unwrap().iter().all(|r| r["status"] == "counted"), "{receipts}");
    server.stop_and_check().await;
}

/// Times of the `Date` headers of many responses, from all threads of the server, in seconds since 1970.
async fn response_dates(api: &ApiClient) -> Vec<i64> {
    let date = async || {
        let response = system_tests::http_client().get(format!("{}/livez", api.base())).send().await.unwrap();
        let date = response.headers()["date"].to_str().unwrap();
        jiff::fmt::rfc2822::parse(date).unwrap().timestamp().as_second()
    };
    futures_util::future::join_all((0..64).map(|_| date())).await
}

#[tokio::test(flavor = "multi_thread")]
async fn date_header_follows_the_clock() {
    let server = FaultyServer::start();
    let api = server.api();
    for offset_ms in [0, DAY_MS, -DAY_MS, 0] {
        server.set(Fault::ClockMs, offset_ms);
        wait_until("all dates follow the clock", async || {
            let now_s = (::clock::Clock::system().now() + offset_ms) / 1000;
            response_dates(&api).await.iter().all(|date| (date - now_s).abs() <= 5)
        })
        .await;
    }
    server.stop_and_check().await;
}
