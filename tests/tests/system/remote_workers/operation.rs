//! Workers as their operator sees them: the list, the metrics, readiness, events and the command line.

use std::process::Command;

use serde_json::Value;
use system_tests::{sparring_binary, wait_until};

use super::*;

/// Runs `sparring` in an empty folder and returns its output.
fn sparring(arguments: &[&str]) -> std::process::Output {
    let folder = tempfile::tempdir().unwrap();
    Command::new(sparring_binary()).args(arguments).current_dir(folder.path()).output().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn operators_see_workers_join_and_leave() {
    let Some(nats) = NatsServer::start() else { return };
    let mut cluster = WorkerCluster::start(Some(nats), 0).await;
    create_run(&cluster).await;
    let api = cluster.api();
    wait_until("the server is connected and degraded", async || {
        let health = api.get("/readyz").await.expect(200);
        health["status"] == "degraded" && health["reason"].as_str().unwrap().contains("no worker")
    })
    .await;
    cluster.add_worker("second-machine");
    cluster.wait_for_workers(1).await;
    train_round(&cluster, 0).await;
    let health: Value = api.get("/readyz").await.expect(200);
    assert_eq!(health, json!({"status": "ok"}));

    let list = cluster.list().await;
    let worker = &list["workers"][0];
    assert_eq!((&worker["host"], &worker["state"]), (&json!("second-machine"), &json!("active")));
    assert_eq!(worker["kinds"], json!(["prepare", "audit", "critique"]));
    assert!(worker["last_seen_s"].as_f64().unwrap() < 5.0 && worker["jobs"].as_u64().unwrap() > 0);
    let text = cluster.metrics().await;
    for line in ["sparring_remote_workers{state=\"active\"} 1", "sparring_remote_degraded 0"] {
        assert!(text.contains(line), "{line} in {text}");
    }
    assert!(text.contains("sparring_worker_jobs_total{worker=\"second-machine-"));

    let shown = sparring(&["workers", "--url", cluster.server().url()]);
    let shown = String::from_utf8(shown.stdout).unwrap();
    assert!(shown.contains("second-machine") && shown.contains("active"), "{shown}");

    // A killed worker stalls after four seconds; then the server is alone again.
    cluster.workers.clear();
    wait_until("the worker stalls", async || cluster.list().await["workers"][0]["state"] == "stalled").await;
    assert_eq!(api.get("/readyz").await.expect(200)["status"], "degraded");
    train_round(&cluster, 1).await;
    wait_until("the loss is an alert", async || {
        let page = api.get("/v1/alerts?lasting=true").await.expect(200);
        page["alerts"].as_array().unwrap().iter().any(|alert| {
            let message = alert["message"].as_str().unwrap();
            alert["rule"] == "worker_lost" && message.contains("no worker is connected")
        })
    })
    .await;
    let db = cluster.db();
    wait_until("the run has the events", async || {
        let workers = stored_state::event_messages(&db, "worker").await;
        let warnings = stored_state::event_messages(&db, "warning").await;
        let has = |messages: &[String], part: &str| messages.iter().any(|message| message.contains(part));
        has(&workers, "joined")
            && has(&workers, "Workers do jobs again")
            && has(&warnings, "sends no heartbeats")
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_without_nats_has_no_workers() {
    let cluster = WorkerCluster::start(None, 0).await;
    let list = cluster.list().await;
    assert_eq!((&list["distributed"], &list["workers"]), (&json!(false), &json!([])));
    assert_eq!(cluster.api().get("/readyz").await.expect(200), json!({"status": "ok"}));
    assert!(!cluster.metrics().await.contains("sparring_remote_degraded "));
    let shown = sparring(&["workers", "--url", cluster.server().url()]);
    assert!(String::from_utf8(shown.stdout).unwrap().contains("does all jobs itself"));
}
