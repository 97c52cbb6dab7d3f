//! Clients that are connected to a run when it is deleted.

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, TestSocket, http_client};

use super::{archive, archive_and_delete, create, delete, is_unknown_run};

/// Reads an event stream to its end.
async fn read_events(api: &ApiClient, run: &str) -> tokio::task::JoinHandle<String> {
    let url = format!("{}/v1/runs/{run}/events?after=0", api.base());
    let response = http_client().get(url).send().await.unwrap();
    tokio::spawn(async move { response.text().await.unwrap() })
}

#[tokio::test]
async fn deletion_ends_event_streams_and_long_polls() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, "gone", json!({})).await;
    create(&api, "kept", json!({})).await;
    let events = read_events(&api, "gone").await;
    let poll = tokio::spawn({
        let api = api.clone();
        async move { api.post("/v1/runs/gone/trajectories/claim", json!({"wait_s": 60})).await }
    });
    archive_and_delete(&api, "gone").await;
    let events = events.await.unwrap();
    let last = events.trim().rsplit("\n\n").next().unwrap();
    assert!(last.contains("event: run") && last.contains(r#""state":"deleted""#), "{events}");
    assert!(is_unknown_run(&poll.await.unwrap()));
    let _ = api.get("/v1/runs/kept").await.expect(200);
}

#[tokio::test]
async fn sessions_of_a_deleted_run_cannot_step() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, "gone", json!({})).await;
    let lease = api.lease("gone", json!({"groups": 4})).await;
    let mut single = TestSocket::connect(&api, "/v1/sessions").await;
    let opened = single.request(&json!({"type": "open", "version": 2, "run": "gone"})).await;
    assert_eq!(opened["type"], "opened", "{opened}");
    let mut vector = TestSocket::connect(&api, "/v1/sessions").await;
    let open =
        json!({"type": "open", "version": 2, "run": "gone", "lease_id": lease.id(), "vector": {"envs": 2}});
    let opened = vector.request(&open).await;
    assert_eq!(opened["type"], "opened", "{opened}");
    let first = vector.receive_bytes().await;
    let mut openenv = TestSocket::connect(&api, "/ws").await;
    let reset = openenv.request(&json!({"type": "reset", "data": {"run": "gone"}})).await;
    assert_eq!(reset["type"], "observation", "{reset}");

    archive(&api, "gone").await;
    let step = json!({"type": "step", "id": 1, "action": {"burns": []}});
    assert_eq!(single.request(&step).await["type"], "stepped", "an archived run still takes results");
    let _ = delete(&api, "gone", "?name=the%20run%20gone").await.expect(200);

    let step = json!({"type": "step", "id": 2, "action": {"burns": []}});
    let refused = single.request(&step).await;
    assert_eq!((&refused["type"], &refused["code"]), (&json!("error"), &json!("unknown_run")), "{refused}");
    vector.send_bytes(&step_frame(&first, &opened)).await;
    let refused = vector.receive_text().await;
    assert_eq!(refused["code"], "unknown_run", "{refused}");
    let refused = openenv.request(&json!({"type": "step", "data": {"burns": []}})).await;
    assert!(refused["data"]["message"].as_str().unwrap().contains("run gone does not exist"), "{refused}");
    let refused = openenv.request(&json!({"type": "reset", "data": {"run": "gone"}})).await;
    assert!(refused["data"]["message"].as_str().unwrap().contains("run gone does not exist"), "{refused}");
    // The connections can be used for other episodes.
    let reset = openenv.request(&json!({"type": "reset", "data": {"task": "survival", "seed": 1}})).await;
    assert_eq!(reset["type"], "observation", "{reset}");
}

/// Builds the first frame of actions, all zeros, of a session with this first step frame.
fn step_frame(first: &[u8], opened: &Value) -> Vec<u8> {
    let number = |name: &str| opened[name].as_u64().unwrap() as usize;
    let mut frame = first[..16].to_vec();
    frame[6..8].copy_from_slice(&1u16.to_le_bytes()); // kind: actions
    frame[8..12].copy_from_slice(&1u32.to_le_bytes()); // number of the frame
    frame.extend(std::iter::repeat_n(0, number("envs") * number("agents") * number("action") * 4));
    frame
}
