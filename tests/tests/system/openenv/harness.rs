//! `/harness`: the language model of the server acts for the client, turn by turn.

use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::mock_llm::{chat_response, received_bodies, start_endpoint};
use system_tests::{ApiClient, Received, Server, TestSocket};
use wiremock::ResponseTemplate;

use crate::trajectories::chat_policy::{BURN, model_config, start_server};

async fn connect(api: &ApiClient, query: &str) -> TestSocket {
    TestSocket::connect(api, &format!("/harness{query}")).await
}

async fn receive(socket: &mut TestSocket) -> Value {
    match socket.receive().await {
        Received::Text(frame) => frame,
        other => panic!("no text frame: {other:?}"),
    }
}

/// Sends an instruction and returns the events of the turn.
async fn turn(socket: &mut TestSocket, content: &str) -> Vec<Value> {
    socket.send_text(json!({"type": "message", "content": content}).to_string()).await;
    let mut events = Vec::new();
    loop {
        let event = receive(socket).await;
        let kind = event["type"].as_str().unwrap().to_owned();
        events.push(event);
        if kind == "turn_complete" || kind == "error" {
            return events;
        }
    }
}

fn kinds(events: &[Value]) -> Vec<&str> {
    events.iter().map(|event| event["type"].as_str().unwrap()).collect()
}

#[tokio::test]
async fn model_acts_until_the_episode_is_over() {
    let mock = start_endpoint([chat_response(BURN)]).await;
    let server = start_server(model_config(&mock.uri())).await;
    let api = server.api();
    let mut socket = connect(&api, "?task=rendezvous&seed=5").await;
    let started = receive(&mut socket).await;
    assert_eq!((&started["type"], &started["data"]["harness"]), (&json!("session_started"), &json!("chat")));
    assert!(started["data"]["session_id"].is_string());

    let events = turn(&mut socket, "Fly carefully.").await;
    let steps = (events.len() - 1) / 4;
    for (at, step) in events[..events.len() - 1].chunks(4).enumerate() {
        assert_eq!(kinds(step), ["llm_request", "llm_response", "tool_call", "tool_result"], "{at}");
        assert_eq!(step[2]["data"]["arguments"]["burns"][0]["satellite_id"], 1);
        assert_eq!(step[3]["data"]["result"]["done"], json!(at + 1 == steps));
        assert!(step.iter().all(|event| event["timestamp"].as_f64().unwrap() > 1.7e9));
    }
    let end = &events.last().unwrap()["data"];
    assert_eq!((&end["done"], &end["state"]["step_count"]), (&json!(true), &json!(steps)));
    assert_eq!(end["state"]["task"], "kessler/rendezvous");
    assert!(end["response"].as_str().unwrap().contains("over after"), "{end}");
    let requests = received_bodies(&mock).await;
    assert_eq!(requests.len(), steps);
    let system = requests[0]["messages"][0]["content"].as_str().unwrap();
    assert!(system.ends_with("Instructions of the user:\nFly carefully."), "{system}");

    // The next instruction begins another episode, without the first one's.
    let again = turn(&mut socket, "Hurry.").await;
    assert_eq!(again.last().unwrap()["type"], "turn_complete");
    let requests = received_bodies(&mock).await;
    let system = requests.last().unwrap()["messages"][0]["content"].as_str().unwrap();
    assert!(system.ends_with("Hurry.") && !system.contains("carefully"), "{system}");
}

#[tokio::test]
async fn episodes_of_a_run_are_counted() {
    let mock = start_endpoint([chat_response(BURN)]).await;
    let server = start_server(model_config(&mock.uri())).await;
    let api = server.api();
    let _ = api
        .post("/v1/runs", json!({"id": "r", "tasks": ["kessler/survival"], "group_size": 1}))
        .await
        .expect(201);
    let mut socket = connect(&api, "?run=r").await;
    let _ = receive(&mut socket).await;
    let events = turn(&mut socket, "").await;
    let state = &events.last().unwrap()["data"]["state"];
    assert_eq!(state["run"], "r", "{state}");
    let episodes = api.get("/v1/runs/r/episodes").await.expect(200);
    assert_eq!(episodes["episodes"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn invalid_messages_leave_the_session_and_failures_end_it() {
    let mock = start_endpoint([ResponseTemplate::new(500)]).await;
    let server = start_server(model_config(&mock.uri())).await;
    let api = server.api();
    let mut socket = connect(&api, "").await;
    let _ = receive(&mut socket).await;
    for (text, code) in [
        ("{", "INVALID_JSON"),
        ("[]", "VALIDATION_ERROR"),
        (r#"{"type": "reset"}"#, "VALIDATION_ERROR"),
        (r#"{"type": "message"}"#, "VALIDATION_ERROR"),
        (r#"{"type": "message", "content": 3}"#, "VALIDATION_ERROR"),
    ] {
        socket.send_text(text).await;
        let answer = receive(&mut socket).await;
        assert_eq!(
            (&answer["type"], &answer["data"]["code"]),
            (&json!("protocol_error"), &json!(code)),
            "{text}"
        );
    }
    let events = turn(&mut socket, "go").await;
    let error = &events.last().unwrap();
    assert_eq!((&error["type"], &error["data"]["recoverable"]), (&json!("error"), &json!(false)), "{error}");
    assert!(matches!(socket.receive().await, Received::Closed(_)));

    for (query, message) in [
        ("?task=golf", "task"),
        ("?seed=x", "seed"),
        ("?run=missing", "missing"),
        ("?run_id=r", "\"run_id\" is not a known field; the known fields are task, seed, run"),
        ("?seed=1&seed=2", "seed is repeated"),
    ] {
        let mut socket = connect(&api, query).await;
        let error = receive(&mut socket).await;
        assert_eq!(error["data"]["code"], "SESSION_ERROR");
        assert!(error["data"]["message"].as_str().unwrap().contains(message), "{error}");
    }
    let plain = Server::start().await;
    let mut socket = connect(&plain.api(), "").await;
    let error = receive(&mut socket).await;
    assert_eq!(error["data"]["code"], "FACTORY_ERROR");
    assert!(error["data"]["message"].as_str().unwrap().contains("--policy-url"), "{error}");
}

/// A turn costs calls of the operator's model, so that the route is not public with the others.
#[tokio::test]
async fn public_server_requires_a_token_for_a_harness() {
    let server = Server::with_config(|config| Config { openenv_public: true, ..config }).await;
    let api = server.api();
    let _ = api.get("/harness").await.expect(401);
    let _ = api.get("/ws").await.expect(404); // public, and only for WebSockets
}
