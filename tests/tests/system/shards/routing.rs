//! nginx routes requests by the shard of their ids.

use std::time::Duration;

use serde_json::{Value, json};
use system_tests::shard_cluster::ShardCluster;
use system_tests::{ApiClient, TestSocket, http_client};

use super::{TASK, create, ids, train};

/// Time in which an event must pass the proxy.
const DELIVERY: Duration = Duration::from_secs(10);

/// Pauses a run, and waits for the event of it on the stream of its events.
async fn assert_events_pass(api: &ApiClient, run: &str) {
    let events = format!("{}/v1/runs/{run}/events", api.base());
    let opened = tokio::time::timeout(DELIVERY, http_client().get(events).send()).await;
    let mut stream = opened.expect("the head of the stream is passed on").unwrap();
    let _ = api.post(&format!("/v1/runs/{run}/pause"), Value::Null).await.expect(200);
    let mut text = String::new();
    while !text.contains("paused") {
        let part = tokio::time::timeout(DELIVERY, stream.chunk()).await.expect("the event is passed on");
        text.push_str(&String::from_utf8_lossy(&part.unwrap().expect("the stream goes on")));
    }
    let _ = api.post(&format!("/v1/runs/{run}/resume"), Value::Null).await.expect(200);
}

#[tokio::test(flavor = "multi_thread")]
async fn runs_of_both_shards_train_through_the_proxy() {
    let cluster = ShardCluster::start().await;
    let api = cluster.api();
    let mut runs = vec![create(&api, json!({})).await, create(&api, json!({})).await];
    runs.sort();
    assert!(
        runs[0].starts_with("east.run-") && runs[1].starts_with("west.run-"),
        "created in turn: {runs:?}"
    );
    for run in &runs {
        train(&api, run, 8).await;
        for path in ["mastery", "series", "overview", "episodes", "settings", "leases", "trainers", "sampler"]
        {
            assert_eq!(api.get(&format!("/v1/runs/{run}/{path}")).await.status, 200, "{run} {path}");
        }
        assert_eq!(api.get(&format!("/v1/runs/{run}")).await.expect(200)["episodes"], 8);
        assert_events_pass(&api, run).await;
        let poll = api.get(&format!("/v1/runs/{run}/trajectories?wait_s=1")).await.expect(200);
        assert_eq!(poll["groups"], json!([]));
    }
    assert_eq!(ids(&cluster.east.api().get("/v1/runs").await.expect(200)).len(), 2);
    // Responses name the server, and a path of a whole server reaches it.
    for shard in ["east", "west"] {
        assert_eq!(api.get(&format!("/shards/{shard}/v1/health")).await.expect(200)["shard"], shard);
        let response =
            http_client().get(format!("{}/shards/{shard}/livez", api.base())).send().await.unwrap();
        assert_eq!(response.headers()["sparring-shard"], shard);
        assert_eq!(api.get(&format!("/shards/{shard}/metrics")).await.status, 200);
    }
    assert_eq!(api.get("/dashboard/").await.status, 200);
}

#[tokio::test(flavor = "multi_thread")]
async fn sessions_pass_the_proxy() {
    let cluster = ShardCluster::start().await;
    let api = cluster.api();
    for shard in ["east", "west"] {
        let run = create(&api, json!({"id": format!("{shard}.stepped"), "group_size": 1})).await;
        let mut socket = TestSocket::connect(&api, &format!("/v1/runs/{run}/sessions")).await;
        let opened = socket.request(&json!({"type": "open", "version": 2})).await;
        assert_eq!((&opened["type"], &opened["task"]), (&json!("opened"), &json!(TASK)), "{opened}");
        let stepped = socket.request(&json!({"type": "step", "id": 1, "action": {"burns": []}})).await;
        assert_eq!(stepped["type"], "stepped", "{stepped}");
        socket.close().await;
        let leases = api.get(&format!("/v1/runs/{run}/leases")).await.expect(200);
        assert_eq!(leases["leases"].as_array().unwrap().len(), 1, "{leases}");

        let lease = api.lease(&run, json!({"groups": 2})).await;
        let mut vector = TestSocket::connect(&api, &format!("/v1/runs/{run}/sessions")).await;
        let open = json!({"type": "open", "version": 2, "lease_id": lease.id(), "vector": {"envs": 2, "observe": "tracks"}});
        let opened = vector.request(&open).await;
        assert_eq!(opened["type"], "opened", "{opened}");
        assert!(!vector.receive_bytes().await.is_empty());
    }
    // The path of a whole server reaches its sessions.
    let mut socket = TestSocket::connect(&api, "/shards/west/v1/sessions").await;
    let opened = socket.request(&json!({"type": "open", "version": 2, "run": "west.stepped"})).await;
    assert_eq!(opened["type"], "opened", "{opened}");
    // A connection of one run opens no other run, and a run of another shard is named with its path.
    let mut socket = TestSocket::connect(&api, "/v1/runs/east.stepped/sessions").await;
    let other = socket.request(&json!({"type": "open", "version": 2, "run": "west.stepped"})).await;
    assert_eq!((&other["type"], &other["field"]), (&json!("error"), &json!("run")), "{other}");
    let mut socket = TestSocket::connect(&cluster.east.api(), "/v1/sessions").await;
    let other = socket.request(&json!({"type": "open", "version": 2, "run": "west.stepped"})).await;
    assert!(other["detail"].as_str().unwrap().contains("/v1/runs/west.stepped/sessions"), "{other}");
}

#[tokio::test(flavor = "multi_thread")]
async fn ids_of_other_shards_are_refused_with_the_remedy() {
    let cluster = ShardCluster::start().await;
    let (api, east) = (cluster.api(), cluster.east.api());
    create(&api, json!({"id": "west.mine"})).await;
    for path in [
        "/v1/runs/west.mine",
        "/v1/runs/west.mine/mastery",
        "/v1/evaluations/west.eval-1",
        "/v1/layouts/west.layout-1",
    ] {
        let refused = east.get(path).await.expect(421);
        assert_eq!(refused["type"], "urn:sparring:problem:other_shard", "{path}");
        assert!(refused["detail"].as_str().unwrap().contains("this server is the shard east"), "{refused}");
    }
    let _ = east.post("/v1/runs/west.mine/pause", Value::Null).await.expect(421);
    let taken = api.post("/v1/runs", json!({"id": "west.mine"})).await.expect(409);
    assert_eq!(taken["type"], "urn:sparring:problem:run_exists");
    for (id, words) in [
        ("mine", "east.mine or west.mine"),
        ("north.mine", "must begin with east"),
        ("east.", "must be 1 to 64 characters"),
        ("east.a.b", "must be 1 to 64 characters"),
    ] {
        let refused = east.post("/v1/runs", json!({ "id": id })).await.expect(422);
        assert_eq!(refused["field"], "id");
        assert!(refused["detail"].as_str().unwrap().contains(words), "{refused}");
    }
    let unknown = api.get("/v1/runs/north.mine").await.expect(404);
    assert_eq!(unknown["type"], "urn:sparring:problem:unknown_shard");
    let unknown = api.get("/v1/runs/mine").await.expect(404);
    assert_eq!(unknown["type"], "urn:sparring:problem:unknown_run");
    let unknown = api.get("/shards/north/livez").await.expect(404);
    assert_eq!(unknown["type"], "urn:sparring:problem:unknown_shard");
}
