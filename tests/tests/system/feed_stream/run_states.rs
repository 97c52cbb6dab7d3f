//! The key-value bucket with the states of runs.

use async_nats::jetstream::kv::{Operation, Store};

use super::*;

/// Waits until the state of the run meets a condition.
async fn wait_for_state(bucket: &Store, condition: &str, is_met: impl Fn(&Value) -> bool) {
    system_tests::wait_until(condition, async || {
        let Ok(Some(entry)) = bucket.entry("runs.run").await else { return false };
        serde_json::from_slice(&entry.value).is_ok_and(|state| is_met(&state))
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn states_of_runs_can_be_watched() {
    let Some(nats) = NatsServer::start() else { return };
    let mut cluster = WorkerCluster::start(Some(nats), 0).await;
    let api = cluster.api();
    create_run(&api, "run", json!({})).await;
    let context = connect(&cluster).await;
    let bucket =
        wait_for("the bucket exists", async || context.get_key_value("SPARRING_default_RUNS").await.ok())
            .await;
    wait_for_state(&bucket, "the run is active", |state| {
        state["state"] == "active" && state["policy_version"] == 0 && state["policy"] == "off"
    })
    .await;
    let mut changes = bucket.watch("runs.run").await.unwrap();
    let _ = put_policy(&api, "run", json!({"policy": "hold", "version": 3})).await.expect(200);
    let change = changes.next().await.unwrap().unwrap();
    let state: Value = serde_json::from_slice(&change.value).unwrap();
    assert_eq!((&state["policy"], &state["version"]), (&json!("hold"), &json!(3)));
    let _ = put_policy(&api, "run", json!({"policy": "off"})).await.expect(200);
    let settings = json!({"policy_version": 7}).to_string();
    let _ = api.request("PUT", "/v1/runs/run/policy_version", "application/json", settings).await.expect(200);
    wait_for_state(&bucket, "the version is published", |state| state["policy_version"] == 7).await;
    let _ = api.post("/v1/runs/run/pause", json!({})).await.expect(200);
    wait_for_state(&bucket, "the run is paused", |state| state["state"] == "paused").await;

    // What changes while NATS is away follows.
    cluster.nats.as_mut().unwrap().kill();
    let _ = api.post("/v1/runs/run/archive", json!({})).await.expect(200);
    cluster.nats.as_mut().unwrap().resume();
    wait_for_state(&bucket, "the run is archived", |state| state["state"] == "archived").await;
    let deleted = api.request("DELETE", "/v1/runs/run?name=run", "application/json", String::new()).await;
    assert!(deleted.status < 300, "{deleted:?}");
    system_tests::wait_until("the run is gone", async || {
        let entry = bucket.entry("runs.run").await;
        matches!(entry, Ok(Some(entry)) if entry.operation == Operation::Purge)
    })
    .await;
}
