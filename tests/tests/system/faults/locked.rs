//! Another process locks the database: changes are refused after five seconds at the latest, then at once, and reads do not wait.

use std::time::{Duration, Instant};

use futures_util::future::join_all;
use serde_json::json;
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{ApiClient, ApiResponse, TestSocket};

use super::{FaultyServer, report, start_run, wait_until_ready};

/// Reads that must not wait for the lock.
const READS: [&str; 9] = [
    "/livez",
    "/readyz",
    "/metrics",
    "/v1/runs",
    "/v1/runs/run/mastery",
    "/v1/runs/run/params",
    "/v1/runs/run/overview",
    "/v1/runs/run/series",
    "/v1/runs/run/sampler",
];

/// Longest duration of an answer that waits for nothing, on a busy machine.
const PROMPT: Duration = Duration::from_millis(1500);

async fn create(api: &ApiClient, number: u32) -> ApiResponse {
    api.post("/v1/runs", json!({"id": format!("other-{number}"), "tasks": ["kessler/survival"]})).await
}

fn assert_locked(response: &ApiResponse) {
    assert_eq!(response.status, 503, "{}", response.body);
    let detail = response.body["detail"].as_str().unwrap();
    assert!(detail.contains("another process holds the database lock"), "{detail}");
}

/// Requests each path once and fails if an answer took long.
async fn read_all(api: &ApiClient) {
    for path in READS {
        let start = Instant::now();
        let response = api.get(path).await;
        let elapsed = start.elapsed();
        assert!(elapsed < PROMPT, "{path} took {elapsed:?} while the database was locked");
        let expected: &[u16] = if path == "/readyz" { &[200, 503] } else { &[200] };
        assert!(expected.contains(&response.status), "{path}: {}", response.body);
    }
}

async fn lock_refuses_waiting_changes(lock: &'static str) {
    let server = FaultyServer::start();
    let api = server.api();
    let (results, _) = start_run(&api).await;
    let mut other = SqliteConnectOptions::new().filename(server.db()).connect().await.unwrap();
    sqlx::query(lock).execute(&mut other).await.unwrap();

    let start = Instant::now();
    let changes = tokio::spawn({
        let api = api.clone();
        async move { join_all((0..32).map(|number| create(&api, number))).await }
    });
    while !changes.is_finished() {
        read_all(&api).await; // in the time in which the writer waits for the lock
    }
    let elapsed = start.elapsed();
    changes.await.unwrap().iter().for_each(assert_locked);
    assert!(elapsed < Duration::from_secs(10), "32 changes were refused after {elapsed:?}");

    let start = Instant::now();
    assert_locked(&create(&api, 40).await);
    assert_locked(&report(&api, &results).await);
    assert!(start.elapsed() < 2 * PROMPT, "a known lock refuses at once, not after {:?}", start.elapsed());
    read_all(&api).await;
    let ready = api.get("/readyz").await;
    assert_locked(&ready);
    let metrics = api.get("/metrics").await;
    assert!(metrics.body.as_str().unwrap().contains("sparring_writable 0"));

    sqlx::query("ROLLBACK").execute(&mut other).await.unwrap();
    drop(other);
    wait_until_ready(&api).await;
    let _ = create(&api, 41).await.expect(201);
    let receipts = report(&api, &results).await.expect(200);
    assert!(receipts["results"].as_array().unwrap().iter().all(|r| r["status"] == "counted"), "{receipts}");
    server.stop_and_check().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn immediate_lock_refuses_all_waiting_changes_at_once() {
    lock_refuses_waiting_changes("BEGIN IMMEDIATE").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn exclusive_lock_refuses_all_waiting_changes_at_once() {
    lock_refuses_waiting_changes("BEGIN EXCLUSIVE").await;
}

/// A known lock refuses every try at once, so the number of tries must not be small.
#[tokio::test(flavor = "multi_thread")]
async fn session_reports_its_episode_after_a_long_lock() {
    let server = FaultyServer::start();
    let api = server.api();
    let _ = start_run(&api).await;
    let mut socket = TestSocket::connect(&api, "/v1/sessions").await;
    let opened = socket.request(&json!({"type": "open", "version": 2, "run": "run"})).await;
    assert_eq!(opened["type"], "opened", "{opened}");
    let mut other = SqliteConnectOptions::new().filename(server.db()).connect().await.unwrap();
    sqlx::query("BEGIN IMMEDIATE").execute(&mut other).await.unwrap();
    let unlock = tokio::spawn(async move {
        // Tests the passing of time: the lock lasts much longer than the writer waits for it.
        tokio::time::sleep(Duration::from_secs(18)).await;
        sqlx::query("ROLLBACK").execute(&mut other).await.unwrap();
    });
    for id in 1..=50 {
        let stepped = socket.request(&json!({"type": "step", "id": id, "action": {}})).await;
        if stepped["done"] == true {
            assert_eq!(stepped["reported"]["status"], "counted", "{stepped}");
            unlock.await.unwrap();
            return server.stop_and_check().await;
        }
    }
    panic!("the episode has no end");
}
