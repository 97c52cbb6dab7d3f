//! Faults of the disk beside a full one: a file system that becomes read-only, reads that fail, and a single sync that fails.

use std::time::{Duration, Instant};

use serde_json::Value;
use system_tests::faults::{EIO, EROFS, Fault};
use system_tests::{ApiClient, wait_until};

use super::{FaultyServer, assert_recovery, report, start_run, stored_episodes, wait_until_ready};

/// Errno of a disk that does not answer.
const ETIMEDOUT: i64 = 110;

#[tokio::test(flavor = "multi_thread")]
async fn read_only_file_system_is_reported_and_recovered() {
    assert_recovery(Fault::Write, EROFS, "mounted read-only").await;
}

fn statuses(receipts: &Value) -> Vec<&str> {
    receipts["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect()
}

/// Reports a result until the server accepts it. Returns true if it was rejected at least once.
async fn report_until_accepted(api: &ApiClient, result: &Value) -> bool {
    let mut was_rejected = false;
    wait_until("the result is accepted", async || {
        let response = report(api, std::slice::from_ref(result)).await;
        assert!(matches!(response.status, 200 | 503), "{}", response.body);
        was_rejected |= response.status == 503;
        response.status == 200
    })
    .await;
    was_rejected
}

#[tokio::test(flavor = "multi_thread")]
async fn single_failed_sync_loses_nothing() {
    let server = FaultyServer::start();
    let api = server.api();
    let (results, _) = start_run(&api).await;
    let mut rejections = 0;
    for result in &results {
        server.set(Fault::SyncFailures, 1);
        rejections += u32::from(report_until_accepted(&api, result).await);
        wait_until("one sync failed", async || server.get(Fault::SyncFailures) <= 0).await;
    }
    // The sync of a checkpoint may fail instead.
    assert!(rejections > 0, "a report whose sync fails is rejected");
    wait_until_ready(&api).await;
    let server = server.restart(); // a kill: what was acknowledged must be in the files
    let api = server.api();
    assert_eq!(stored_episodes(&api).await, 8);
    let receipts = report(&api, &results).await.expect(200);
    assert_eq!(statuses(&receipts), ["duplicate"; 8]);
    server.stop_and_check().await;
}

/// Starts a server with three reported episodes and empty caches, whose reads then fail with an errno. Waits until it is not ready.
async fn fail_reads(errno: i64) -> (FaultyServer, Vec<Value>) {
    let server = FaultyServer::start();
    let (results, _) = start_run(&server.api()).await;
    let _ = report(&server.api(), &results[..3]).await.expect(200);
    let server = server.restart();
    let api = server.api();
    server.set(Fault::Read, errno);
    wait_until("the server is not ready", async || {
        for path in ["/v1/runs/run/episodes?limit=500", "/v1/runs/run/leases", "/v1/runs/run/mastery"] {
            let response = api.get(path).await;
            assert!(matches!(response.status, 200 | 503), "{path}: {}", response.body);
        }
        api.get("/readyz").await.status == 503
    })
    .await;
    let rejected = report(&api, &results[3..]).await;
    assert_eq!(rejected.status, 503, "{}", rejected.body);
    // If the server cannot read whether it has tokens, it serves no metrics either.
    let metrics = api.get("/metrics").await;
    assert!(
        metrics.status == 503 || metrics.body.to_string().contains("sparring_writable 0"),
        "{}",
        metrics.body
    );
    assert_eq!(api.get("/livez").await.status, 200);
    (server, results)
}

async fn assert_not_ready(api: &ApiClient, reason: &str) {
    let ready = api.get("/readyz").await.expect(503);
    assert!(ready["detail"].as_str().unwrap().contains(reason), "{ready}");
}

#[tokio::test(flavor = "multi_thread")]
async fn failing_reads_stop_changes_until_they_succeed() {
    let (server, results) = fail_reads(ETIMEDOUT).await;
    let api = server.api();
    assert_not_ready(&api, "the disk failed").await;
    let _ = api.get("/v1/runs/run/episodes").await; // the time in which changes are refused begins again
    server.set(Fault::Read, 0);
    let start = Instant::now();
    let rejected = report(&api, &results[3..]).await;
    assert!(rejected.status == 503 || start.elapsed() > Duration::from_secs(8), "{}", rejected.body);
    wait_until_ready(&api).await;
    let receipts = report(&api, &results).await.expect(200);
    assert_eq!(statuses(&receipts)[..4], ["duplicate", "duplicate", "duplicate", "counted"]);
    server.stop_and_check().await;
}

/// SQLite takes EIO for damage. The server cannot know better, so it waits for its operator.
#[tokio::test(flavor = "multi_thread")]
async fn unreadable_sectors_stop_the_server_until_a_restart() {
    let (server, results) = fail_reads(EIO).await;
    server.set(Fault::Read, 0);
    // Tests the passing of time: the server does not become ready by itself.
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert_not_ready(&server.api(), "or the disk cannot read it").await;
    let server = server.restart();
    let receipts = report(&server.api(), &results).await.expect(200);
    assert_eq!(statuses(&receipts)[..4], ["duplicate", "duplicate", "duplicate", "counted"]);
    server.stop_and_check().await;
}
