//! Archiving of many runs, and deletion of archived runs by age.

use std::sync::atomic::Ordering;
use std::time::Duration;

use clock::Clock;
use orchestrator::retention::archived::ArchivedRetention;
use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{ApiClient, Server, wait_until};

use super::{create, is_unknown_run};

/// Time of the manual clock at the start.
const START_MS: i64 = 1_800_000_000_000;
const DAY_MS: i64 = 24 * 3600 * 1000;

/// Ids of the listed runs.
async fn listed(api: &ApiClient, query: &str) -> Vec<Value> {
    let page = api.get(&format!("/v1/runs{query}")).await.expect(200);
    page["runs"].as_array().unwrap().iter().map(|run| run["id"].clone()).collect()
}

#[tokio::test]
async fn many_runs_are_archived_or_none() {
    let server = Server::start().await;
    let api = server.api();
    for run in ["a", "b", "c"] {
        create(&api, run, json!({})).await;
    }
    let refused = api.post("/v1/archive", json!({"runs": ["a", "unknown", "b"]})).await.expect(422);
    assert_eq!((&refused["field"], listed(&api, "").await.len()), (&json!("runs.1"), 3), "{refused}");
    for (request, field) in [
        (json!({"runs": []}), "runs"),
        (json!({"runs": vec!["a"; 1001]}), "runs"),
        (json!({"runs": ["a", "not an id"]}), "runs.1"),
        (json!({"runs": "a"}), "runs"),
        (json!({}), "runs"),
    ] {
        let refused = api.post("/v1/archive", request).await.expect(422);
        assert_eq!(refused["field"], field, "{refused}");
    }
    let archived = api.post("/v1/archive", json!({"runs": ["c", "a"]})).await.expect(200);
    assert_eq!((&archived["runs"][0]["id"], &archived["runs"][1]["id"]), (&json!("c"), &json!("a")));
    assert!(archived["runs"][0]["archived_at"].is_string());
    assert_eq!(
        (listed(&api, "").await, listed(&api, "?archived=true").await),
        (vec![json!("b")], vec![json!("a"), json!("c")])
    );
    // Again: nothing changes.
    let again = api.post("/v1/archive", json!({"runs": ["a"]})).await.expect(200);
    assert_eq!(again["runs"][0], archived["runs"][1]);
}

#[tokio::test(flavor = "multi_thread")]
async fn archived_runs_are_deleted_by_age() {
    let manual = Clock::manual(START_MS);
    let (clock, clock_ms) = (manual.clock, manual.time);
    let retention = ArchivedRetention::of_days(30).with_confirmation(Duration::from_millis(50));
    let config = move |config| Config { clock: clock.clone(), archived_retention: Some(retention), ..config };
    let mut server = Server::with_config(config).await;
    let api = server.api();
    for run in ["old", "restored", "young", "active"] {
        create(&api, run, json!({})).await;
    }
    let _ = api.post("/v1/archive", json!({"runs": ["old", "restored"]})).await.expect(200);
    clock_ms.fetch_add(20 * DAY_MS, Ordering::SeqCst);
    let _ = api.post("/v1/archive", json!({"runs": ["young"]})).await.expect(200);
    let _ = api.post("/v1/runs/restored/resume", json!({})).await.expect(200);
    clock_ms.fetch_add(11 * DAY_MS, Ordering::SeqCst);
    wait_until("the old run is deleted", async || is_unknown_run(&api.get("/v1/runs/old").await)).await;
    // The other runs stay, also after a restart.
    server.restart().await;
    let api = server.api();
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert_eq!(listed(&api, "").await, ["active", "restored"]);
    assert_eq!(listed(&api, "?archived=true").await, ["young"]);
    let log = api.get("/v1/audit").await.expect(200);
    let entry = &log["entries"][0];
    assert_eq!(
        (&entry["operation"], &entry["path"]),
        (&json!("server: delete old archived run"), &json!("/v1/runs/old")),
        "{log}"
    );
}

/// Without the option, archived runs stay.
#[tokio::test]
async fn archived_runs_are_kept_by_default() {
    let manual = Clock::manual(START_MS);
    let (clock, clock_ms) = (manual.clock, manual.time);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    create(&api, "old", json!({})).await;
    let _ = api.post("/v1/archive", json!({"runs": ["old"]})).await.expect(200);
    clock_ms.fetch_add(4000 * DAY_MS, Ordering::SeqCst);
    tokio::time::sleep(Duration::from_millis(300)).await;
    assert_eq!(listed(&api, "?archived=true").await, ["old"]);
}
