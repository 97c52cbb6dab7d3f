//! Clocks that go backwards: in one jump, in steps that the server follows at once, and between two servers.

use std::time::Duration;

use serde_json::{Value, json};
use system_tests::faults::Fault;
use system_tests::{ApiClient, wait_until};

use super::{DAY_MS, FaultyServer, report, start_run};

/// Largest step that the server does not take for a jump.
const SMALL_STEP_MS: i64 = 1_900;

async fn lease_status(api: &ApiClient, lease: &Value) -> Value {
    let id = lease["lease"].as_str().unwrap();
    api.get(&format!("/v1/runs/run/leases/{id}")).await.expect(200)["status"].clone()
}

async fn assert_all_counted(api: &ApiClient, results: &[Value]) {
    let receipts = report(api, results).await.expect(200);
    assert!(receipts["results"].as_array().unwrap().iter().all(|r| r["status"] == "counted"), "{receipts}");
}

async fn assert_short_lease_expires(api: &ApiClient) {
    let lease = api.lease("run", json!({"groups": 1, "ttl_s": 1})).await;
    wait_until("a lease of one second expires", async || lease_status(api, &lease.0).await == "expired")
        .await;
}

/// Reads everything that is computed from times.
async fn assert_views_answer(api: &ApiClient) {
    for path in ["overview", "series", "mastery", "episodes", "leases", "level_moves"] {
        let _ = api.get(&format!("/v1/runs/run/{path}")).await.expect(200);
    }
}

/// Shifts the clock and waits until the deadline of the lease follows. The lease stays active.
async fn jump(server: &FaultyServer, lease: &Value, offset_ms: i64) {
    let api = server.api();
    let expires =
        |lease: &Value| lease["expires_at"].as_str().unwrap().parse::<jiff::Timestamp>().unwrap().as_second();
    let before = expires(lease);
    server.set(Fault::ClockMs, offset_ms);
    let id = lease["lease"].as_str().unwrap();
    wait_until("the deadline of the lease follows the clock", async || {
        let now = api.get(&format!("/v1/runs/run/leases/{id}")).await.expect(200);
        assert_eq!(now["status"], "active", "a clock jump does not end a lease");
        let moved = expires(&now) - before;
        (moved - offset_ms / 1000).abs() <= 3
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn clock_jump_keeps_leases_valid() {
    for offset_ms in [DAY_MS, -DAY_MS] {
        let server = FaultyServer::start();
        let api = server.api();
        let (results, lease) = start_run(&api).await;
        jump(&server, &lease, offset_ms).await;
        assert_all_counted(&api, &results).await;
        assert_short_lease_expires(&api).await;
        server.stop_and_check().await;
    }
}

/// A pause keeps its duration over a jump: the lease neither ends at the resumption nor lasts a day longer.
#[tokio::test(flavor = "multi_thread")]
async fn clock_jump_during_a_pause_keeps_leases_valid() {
    for offset_ms in [DAY_MS, -DAY_MS] {
        let server = FaultyServer::start();
        let api = server.api();
        let (results, lease) = start_run(&api).await;
        let short = api.lease("run", json!({"groups": 1, "ttl_s": 5})).await;
        let _ = api.post("/v1/runs/run/pause", json!({})).await.expect(200);
        jump(&server, &lease, offset_ms).await;
        let _ = api.post("/v1/runs/run/resume", json!({})).await.expect(200);
        assert_all_counted(&api, &results).await;
        wait_until("the lease of 5 seconds expires", async || {
            lease_status(&api, &short.0).await == "expired"
        })
        .await;
        server.stop_and_check().await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn clock_that_steps_back_and_forth_ends_no_lease() {
    let server = FaultyServer::start();
    let api = server.api();
    let (results, lease) = start_run(&api).await;
    let mut reported = 0;
    for direction in [-1, 1] {
        let from = server.get(Fault::ClockMs);
        for step in 1..=20 {
            server.set(Fault::ClockMs, from + direction * step * SMALL_STEP_MS);
            // Tests the passing of time: the server reads the clock at each step.
            tokio::time::sleep(Duration::from_millis(60)).await;
            assert_eq!(lease_status(&api, &lease).await, "active");
            // One result stays, so that the lease does not end.
            if step % 5 == 1 && reported < 7 {
                assert_all_counted(&api, &results[reported..=reported]).await;
                reported += 1;
            }
        }
        assert_views_answer(&api).await;
    }
    assert_short_lease_expires(&api).await;
    server.stop_and_check().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn server_with_an_earlier_clock_continues() {
    let server = FaultyServer::start();
    let (results, lease) = start_run(&server.api()).await;
    assert_all_counted(&server.api(), &results[..4]).await;
    server.set(Fault::ClockMs, -DAY_MS);
    let server = server.restart();
    let api = server.api();
    assert_eq!(lease_status(&api, &lease).await, "active");
    assert_all_counted(&api, &results[4..]).await;
    assert_views_answer(&api).await;
    assert_short_lease_expires(&api).await;
    server.stop_and_check().await;
}
