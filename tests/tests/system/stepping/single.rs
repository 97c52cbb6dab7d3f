//! Single-environment sessions with JSON messages.

use env_core::rollout::{read_log, replay};
use env_core::{Scenario, log::Precision};
use serde_json::{Value, json};
use system_tests::{ApiClient, Received, Server};

use super::client::{SessionSocket, open_message, uniform};

fn burn(step: u64) -> Value {
    json!({"burns": [{"satellite_id": step % 3, "delta_vx": uniform(1, step) - 0.5, "delta_vy": uniform(2, step) - 0.5}]})
}

/// Holds until the episode ends, with message ids from `id` on; returns the last reply.
pub(crate) async fn hold_to_the_end(socket: &mut SessionSocket, mut id: u64) -> Value {
    loop {
        let reply = socket.step(id, &json!({"burns": []})).await;
        assert_eq!(reply["type"], "stepped", "{reply}");
        if reply["done"] == true {
            return reply;
        }
        id += 1;
    }
}

pub(crate) async fn create_run(api: &ApiClient, id: &str) {
    let options = json!({"strategy": "ladder", "id": id, "seed": 3, "placement": false, "tasks": ["kessler/survival"], "group_size": 2,
                      "contested_share": 0.0, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", options).await.expect(201);
}

#[tokio::test]
async fn episode_runs_to_its_end_and_the_next_one_starts() {
    let server = Server::start().await;
    let options = json!({"task": "survival", "seed": 11, "params": {"debris": 40}, "episode_id": "mine"});
    let (mut socket, opened) = SessionSocket::open(&server.api(), options).await;
    assert_eq!((&opened["version"], &opened["mode"]), (&json!(2), &json!("single")));
    assert_eq!(
        (&opened["agents"], &opened["episode"], &opened["ttl_s"]),
        (&json!(3), &json!("mine"), &json!(60))
    );
    assert_eq!(opened["observation"]["radar_debris"].as_array().unwrap().len(), 40);
    let mut rewards = 0.0;
    let mut steps = Vec::new();
    let mut last = Value::Null;
    for step in 1..=50 {
        let action = burn(step);
        last = socket.step(step * 2, &action).await;
        assert_eq!(
            (&last["type"], &last["id"], &last["step"]),
            (&json!("stepped"), &json!(step * 2), &json!(step))
        );
        rewards += last["reward"].as_f64().unwrap();
        steps.push(action["burns"].clone());
        let team: Vec<u64> =
            last["agents"].as_array().unwrap().iter().map(|a| a["agent"].as_u64().unwrap()).collect();
        assert!(team.iter().all(|agent| *agent < 3) && !team.is_empty(), "{last}");
        if last["done"] == true {
            break;
        }
        assert_eq!(
            (&last["score"], &last["terminated"], &last["truncated"]),
            (&Value::Null, &json!(false), &json!(false))
        );
    }
    assert_eq!(last["done"], true);
    assert_ne!(last["terminated"], last["truncated"], "{last}");
    // The score equals that of a replay of the same actions.
    let scenario = json!({"task": "kessler/survival", "seed": 11, "params": {"debris": 40}});
    let scenario = Scenario::from_json(&scenario).unwrap();
    assert_eq!(opened["scenario"], scenario.id().to_string());
    let log = read_log(&scenario, &steps, Precision::F64, None).unwrap();
    let outcome = replay(&scenario, &log).unwrap();
    assert_eq!(last["score"], json!(outcome.score));
    assert!((rewards - outcome.score).abs() < 1e-3);
    let over = socket.step(1000, &burn(0)).await;
    assert_eq!(
        (&over["type"], &over["code"], &over["id"]),
        (&json!("error"), &json!("episode_over"), &json!(1000))
    );
    // A reset without options repeats the scenario; with options it starts another one.
    let restarted = socket.request(&json!({"type": "reset", "id": 1001})).await;
    assert_eq!((&restarted["type"], &restarted["observation"]), (&json!("started"), &opened["observation"]));
    let other =
        socket.request(&json!({"type": "reset", "id": 1002, "task": "docking/multiagent", "seed": 4})).await;
    assert_eq!(other["observation"]["deputies"].as_array().unwrap().len(), 3);
    let thrust = json!({"thrusts": [{"deputy_id": 0, "thrust_x": 0.5, "thrust_y": 0.0, "thrust_z": 0.0}]});
    assert_eq!(socket.step(1003, &thrust).await["step"], 1);
    let state = socket.request(&json!({"type": "state", "id": 5})).await;
    assert_eq!((&state["id"], &state["steps"], &state["last_id"]), (&json!(5), &json!(1), &json!(1003)));
    let closed = socket.request(&json!({"type": "close"})).await;
    assert_eq!(closed, json!({"type": "closed", "id": null}));
    assert_eq!(socket.receive().await, Received::Closed(1000));
}

#[tokio::test]
async fn session_reports_the_episodes_of_a_run() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run").await;
    let (mut socket, opened) = SessionSocket::open(&api, json!({"run": "run", "group_id": "a"})).await;
    let reply = hold_to_the_end(&mut socket, 1).await;
    assert_eq!(reply["reported"]["status"], "counted", "{reply}");
    assert_eq!(reply["reported"]["episode"], opened["episode"]);
    assert_eq!(reply["reported"]["score"], reply["score"]);
    let _ = socket.request(&json!({"type": "reset", "id": 500})).await;
    let reply = hold_to_the_end(&mut socket, 501).await;
    assert_eq!(reply["reported"]["status"], "counted", "an episode of the same group");
    let none_left = socket.request(&json!({"type": "reset", "id": 900})).await;
    assert_eq!(
        (&none_left["code"], &none_left["field"]),
        (&json!("invalid"), &json!("group_id")),
        "{none_left}"
    );
    let episodes = api.get("/v1/runs/run/episodes").await.expect(200);
    assert_eq!(episodes["episodes"].as_array().unwrap().len(), 2);
}

/// A reset that the server rejects does not end the episode in progress.
#[tokio::test]
async fn rejected_reset_leaves_the_episode_running() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run").await;
    for options in [json!({"seed": 3}), json!({"run": "run"})] {
        let (mut socket, _) = SessionSocket::open(&api, options).await;
        assert_eq!(socket.step(1, &burn(0)).await["step"], 1);
        for other in [json!({"run": "nope"}), json!({"run": "run", "lease_id": "77-aaaaaa"})] {
            let mut reset = json!({"type": "reset", "id": 2});
            reset.as_object_mut().unwrap().extend(other.as_object().unwrap().clone());
            assert_eq!(socket.request(&reset).await["type"], "error");
        }
        assert_eq!(socket.step(2, &burn(0)).await["step"], 2, "the episode continues");
    }
}

#[tokio::test]
async fn repeated_id_repeats_the_reply_without_a_step() {
    let server = Server::start().await;
    let (mut socket, _) = SessionSocket::open(&server.api(), json!({"seed": 1})).await;
    let first = socket.step(7, &burn(1)).await;
    // The reply is repeated for any content, because the id was used.
    for action in [burn(1), burn(2), json!({"burns": "none"})] {
        assert_eq!(socket.step(7, &action).await, first);
    }
    assert_eq!(socket.request(&json!({"type": "reset", "id": 7})).await, first);
    let second = socket.step(8, &burn(2)).await;
    assert_eq!(second["step"], 2);
    let outdated = socket.step(7, &burn(1)).await;
    assert_eq!((&outdated["code"], &outdated["field"]), (&json!("out_of_order"), &json!("id")));
    // A rejected step changes nothing, and its id can be used again.
    let rejected =
        socket.step(9, &json!({"burns": [{"satellite_id": 0, "delta_vx": "NaN", "delta_vy": 0}]})).await;
    assert_eq!(
        (&rejected["code"], &rejected["field"]),
        (&json!("invalid_action"), &json!("action.burns.0.delta_vx"))
    );
    assert_eq!(socket.step(9, &burn(3)).await["step"], 3);
}

type InvalidMessages = Vec<(Value, &'static str, &'static str)>;

/// Invalid first messages, each with the code and field of the error.
fn invalid_open_messages() -> InvalidMessages {
    let evaluation = (1u64 << 52) + 5;
    vec![
        (json!({"type": "step", "id": 1, "action": {}}), "unknown_type", "type"),
        (json!({"type": "open"}), "invalid", "version"),
        (json!({"type": "open", "version": 3}), "unsupported_version", "version"),
        (json!({"version": 2}), "invalid", "type"),
        (json!([1]), "invalid", "message"),
        (open_message(json!({"sede": 1})), "invalid", "sede"),
        (open_message(json!({"seed": evaluation})), "invalid", "seed"),
        (open_message(json!({"seed": -1})), "invalid", "seed"),
        (open_message(json!({"task": "chess"})), "invalid", "task"),
        (open_message(json!({"params": {"fule": 1}})), "invalid", "params.fule"),
        (open_message(json!({"params": {"fuel": "much"}})), "invalid", "params.fuel"),
        (open_message(json!({"physics": {"gravity": "up"}})), "invalid", "physics.gravity"),
        (
            open_message(json!({"scenario": {"task": "kessler/survival", "seed": evaluation}})),
            "invalid",
            "scenario.seed",
        ),
        (open_message(json!({"run": "NO"})), "invalid", "run"),
        (open_message(json!({"run": "r", "seed": 1})), "invalid", "seed"),
        (open_message(json!({"lease_id": "7-abcdef"})), "invalid", "run"),
        (open_message(json!({"group_id": "x".repeat(256)})), "invalid", "group_id"),
    ]
}

/// Invalid first messages of vector sessions, and invalid `resume` messages.
fn invalid_vector_messages() -> InvalidMessages {
    vec![
        (open_message(json!({"vector": {"envs": 0}})), "invalid", "vector.envs"),
        (open_message(json!({"vector": {}})), "invalid", "vector.envs"),
        (open_message(json!({"vector": {"envs": 4, "autoreset": "never"}})), "invalid", "vector.autoreset"),
        (
            open_message(json!({"vector": {"envs": 4, "observe": "tracks", "look_ahead": 99}})),
            "invalid",
            "vector.look_ahead",
        ),
        (open_message(json!({"vector": {"envs": 4, "threats": 3}})), "invalid", "vector.threats"),
        (
            open_message(json!({"vector": {"envs": 4, "observe": "tracks"}, "task": "docking/single"})),
            "invalid",
            "vector.observe",
        ),
        (open_message(json!({"vector": {"envs": 1_000_000}})), "invalid", "vector.envs"),
        (open_message(json!({"vector": {"envs": 4}, "run": "r"})), "invalid", "lease_id"),
        (json!({"type": "resume", "session": "unknown"}), "unknown_session", "session"),
        (json!({"type": "resume"}), "invalid", "session"),
    ]
}

#[tokio::test]
async fn invalid_open_message_is_rejected_by_field() {
    let server = Server::start().await;
    let mut socket = SessionSocket::connect(&server.api()).await;
    for (message, code, field) in invalid_open_messages().into_iter().chain(invalid_vector_messages()) {
        let reply = socket.request(&message).await;
        assert_eq!(
            (&reply["type"], &reply["code"], &reply["field"]),
            (&json!("error"), &json!(code), &json!(field)),
            "{message}: {reply}"
        );
        assert!(reply["detail"].as_str().unwrap().len() > 5 && reply["retryable"] == false, "{reply}");
    }
    let unknown = socket.request(&open_message(json!({"run": "unknown"}))).await;
    assert_eq!(unknown["code"], "unknown_run", "{unknown}");
    socket.send_text("{").await;
    assert_eq!(socket.receive_text().await["code"], "malformed_json");
    socket.send_text("{\"type\": \"open\", \"version\": 1, \"version\": 1}").await;
    assert_eq!(socket.receive_text().await["field"], "version");
    socket.send_bytes(b"SPVF").await;
    assert_eq!(socket.receive_text().await["code"], "not_open");
    assert_eq!(socket.request(&open_message(json!({"seed": 1}))).await["type"], "opened");
}

#[tokio::test]
async fn invalid_message_leaves_the_session_open() {
    let server = Server::start().await;
    let api = server.api();
    let (mut socket, _) = SessionSocket::open(&api, json!({"seed": 1})).await;
    for (message, code) in [
        (open_message(json!({})), "already_open"),
        (json!({"type": "step", "id": 1}), "invalid"),
        (json!({"type": "step", "id": 1, "action": {"burns": []}, "more": 1}), "invalid"),
        (json!({"type": "step", "id": -1, "action": {"burns": []}}), "invalid"),
        (json!({"type": "step", "id": 1u64 << 60, "action": {"burns": []}}), "invalid"),
        (json!({"type": "step", "id": 1, "action": 7}), "invalid_action"),
        (json!({"type": "reset"}), "invalid"),
        (json!({"type": "jump"}), "unknown_type"),
    ] {
        let reply = socket.request(&message).await;
        assert_eq!((&reply["type"], &reply["code"]), (&json!("error"), &json!(code)), "{message}: {reply}");
    }
    socket.send_bytes(&[0; 64]).await;
    assert_eq!(socket.receive_text().await["code"], "not_text");
    assert_eq!(socket.step(1, &burn(1)).await["step"], 1);
    // A plain request is rejected: the route accepts WebSockets only.
    let rejected = api.get("/v1/sessions").await;
    assert_eq!(
        (rejected.status, &rejected.body["type"]),
        (426, &json!("urn:sparring:problem:upgrade_required"))
    );
}
