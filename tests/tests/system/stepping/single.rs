//! One environment, by text.

use env_core::rollout::{read_log, replay};
use env_core::{Scenario, log::Precision};
use serde_json::{Value, json};
use system_tests::{Api, Server};

use super::client::{Came, Socket, draw, opening};

fn burn(step: u64) -> Value {
    json!({"burns": [{"satellite_id": step % 3, "delta_vx": draw(1, step) - 0.5, "delta_vy": draw(2, step) - 0.5}]})
}

/// Flies to the end from this id on; the last answer.
pub(crate) async fn to_the_end(socket: &mut Socket, mut id: u64) -> Value {
    loop {
        let told = socket.step(id, &json!({"burns": []})).await;
        assert_eq!(told["type"], "stepped", "{told}");
        if told["done"] == true {
            return told;
        }
        id += 1;
    }
}

pub(crate) async fn run(api: &Api, id: &str) {
    let wish = json!({"id": id, "seed": 3, "placement": false, "tasks": ["kessler/survival"], "group_size": 2,
                      "contested_share": 0.0, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
}

#[tokio::test]
async fn an_episode_is_flown_to_its_end_and_another_begins() {
    let server = Server::start().await;
    let wish = json!({"task": "survival", "seed": 11, "params": {"debris": 40}, "episode_id": "mine"});
    let (mut socket, opened) = Socket::open(&server.api(), wish).await;
    assert_eq!((&opened["version"], &opened["mode"]), (&json!(1), &json!("single")));
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
    // The score is what a replay of these actions earns.
    let scenario = json!({"task": "kessler/survival", "seed": 11, "params": {"debris": 40}});
    let scenario = Scenario::from_json(&scenario).unwrap();
    assert_eq!(opened["scenario"], scenario.id().to_string());
    let log = read_log(&scenario, &steps, Precision::F64, None).unwrap();
    let flown = replay(&scenario, &log).unwrap();
    assert_eq!(last["score"], json!(flown.score));
    assert!((rewards - flown.score).abs() < 1e-3);
    let over = socket.step(1000, &burn(0)).await;
    assert_eq!((&over["type"], &over["code"], &over["id"]), (&json!("error"), &json!("over"), &json!(1000)));
    // Who wishes nothing gets the same again; a wish is a wish.
    let again = socket.ask(json!({"type": "reset", "id": 1001})).await;
    assert_eq!((&again["type"], &again["observation"]), (&json!("began"), &opened["observation"]));
    let other =
        socket.ask(json!({"type": "reset", "id": 1002, "task": "docking/multiagent", "seed": 4})).await;
    assert_eq!(other["observation"]["deputies"].as_array().unwrap().len(), 3);
    let thrust = json!({"thrusts": [{"deputy_id": 0, "thrust_x": 0.5, "thrust_y": 0.0, "thrust_z": 0.0}]});
    assert_eq!(socket.step(1003, &thrust).await["step"], 1);
    let state = socket.ask(json!({"type": "state", "id": 5})).await;
    assert_eq!((&state["id"], &state["steps"], &state["last_id"]), (&json!(5), &json!(1), &json!(1003)));
    let closed = socket.ask(json!({"type": "close"})).await;
    assert_eq!(closed, json!({"type": "closed", "id": null}));
    assert_eq!(socket.next().await, Came::Closed(1000));
}

#[tokio::test]
async fn a_run_is_told_what_was_flown_for_it() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run").await;
    let (mut socket, opened) = Socket::open(&api, json!({"run": "run", "group_id": "a"})).await;
    let told = to_the_end(&mut socket, 1).await;
    assert_eq!(told["reported"]["status"], "counted", "{told}");
    assert_eq!(told["reported"]["episode"], opened["episode"]);
    assert_eq!(told["reported"]["score"], told["score"]);
    let _ = socket.ask(json!({"type": "reset", "id": 500})).await;
    let told = to_the_end(&mut socket, 501).await;
    assert_eq!(told["reported"]["status"], "counted", "a sibling");
    let none_left = socket.ask(json!({"type": "reset", "id": 900})).await;
    assert_eq!(
        (&none_left["code"], &none_left["field"]),
        (&json!("invalid"), &json!("group_id")),
        "{none_left}"
    );
    let episodes = api.get("/v1/runs/run/episodes").await.expect(200);
    assert_eq!(episodes["episodes"].as_array().unwrap().len(), 2);
}

/// What cannot be begun ends nothing: the episode in flight flies on.
#[tokio::test]
async fn a_refused_reset_moves_nothing() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run").await;
    for wish in [json!({"seed": 3}), json!({"run": "run"})] {
        let (mut socket, _) = Socket::open(&api, wish).await;
        assert_eq!(socket.step(1, &burn(0)).await["step"], 1);
        for other in [json!({"run": "nope"}), json!({"run": "run", "lease_id": "77-aaaaaa"})] {
            let mut reset = json!({"type": "reset", "id": 2});
            reset.as_object_mut().unwrap().extend(other.as_object().unwrap().clone());
            assert_eq!(socket.ask(reset).await["type"], "error");
        }
        assert_eq!(socket.step(2, &burn(0)).await["step"], 2, "it flies on");
    }
}

#[tokio::test]
async fn a_repeated_number_is_answered_again_and_steps_nothing() {
    let server = Server::start().await;
    let (mut socket, _) = Socket::open(&server.api(), json!({"seed": 1})).await;
    let first = socket.step(7, &burn(1)).await;
    // Whatever it asks for: it was taken already.
    for action in [burn(1), burn(2), json!({"burns": "none"})] {
        assert_eq!(socket.step(7, &action).await, first);
    }
    assert_eq!(socket.ask(json!({"type": "reset", "id": 7})).await, first);
    let second = socket.step(8, &burn(2)).await;
    assert_eq!(second["step"], 2);
    let old = socket.step(7, &burn(1)).await;
    assert_eq!((&old["code"], &old["field"]), (&json!("out_of_turn"), &json!("id")));
    // What was refused has moved nothing, and its number is free.
    let refused =
        socket.step(9, &json!({"burns": [{"satellite_id": 0, "delta_vx": "NaN", "delta_vy": 0}]})).await;
    assert_eq!(
        (&refused["code"], &refused["field"]),
        (&json!("invalid_action"), &json!("action.burns.0.delta_vx"))
    );
    assert_eq!(socket.step(9, &burn(3)).await["step"], 3);
}

type Wrong = Vec<(Value, &'static str, &'static str)>;

/// Messages that open nothing, each with the error's code and field.
fn wrong_openings() -> Wrong {
    let evaluation = (1u64 << 52) + 5;
    vec![
        (json!({"type": "step", "id": 1, "action": {}}), "unknown_type", "type"),
        (json!({"type": "open"}), "invalid", "version"),
        (json!({"type": "open", "version": 2}), "version", "version"),
        (json!({"version": 1}), "invalid", "type"),
        (json!([1]), "invalid", "message"),
        (opening(json!({"sede": 1})), "invalid", "sede"),
        (opening(json!({"seed": evaluation})), "invalid", "seed"),
        (opening(json!({"seed": -1})), "invalid", "seed"),
        (opening(json!({"task": "chess"})), "invalid", "task"),
        (opening(json!({"params": {"fule": 1}})), "invalid", "params.fule"),
        (opening(json!({"params": {"fuel": "much"}})), "invalid", "params.fuel"),
        (opening(json!({"physics": {"gravity": "up"}})), "invalid", "physics.gravity"),
        (
            opening(json!({"scenario": {"task": "kessler/survival", "seed": evaluation}})),
            "invalid",
            "scenario.seed",
        ),
        (opening(json!({"run": "NO"})), "invalid", "run"),
        (opening(json!({"run": "r", "seed": 1})), "invalid", "seed"),
        (opening(json!({"lease_id": "7-abcdef"})), "invalid", "run"),
        (opening(json!({"group_id": "x".repeat(256)})), "invalid", "group_id"),
    ]
}

/// The same of vector sessions, and of coming back.
fn wrong_vectors() -> Wrong {
    vec![
        (opening(json!({"vector": {"envs": 0}})), "invalid", "vector.envs"),
        (opening(json!({"vector": {}})), "invalid", "vector.envs"),
        (opening(json!({"vector": {"envs": 4, "autoreset": "never"}})), "invalid", "vector.autoreset"),
        (
            opening(json!({"vector": {"envs": 4, "observe": "tracks", "look_ahead": 99}})),
            "invalid",
            "vector.look_ahead",
        ),
        (opening(json!({"vector": {"envs": 4, "threats": 3}})), "invalid", "vector.threats"),
        (
            opening(json!({"vector": {"envs": 4, "observe": "tracks"}, "task": "docking/single"})),
            "invalid",
            "vector.observe",
        ),
        (opening(json!({"vector": {"envs": 1_000_000}})), "invalid", "vector.envs"),
        (opening(json!({"vector": {"envs": 4}, "run": "r"})), "invalid", "lease_id"),
        (json!({"type": "resume", "session": "nobody"}), "unknown_session", "session"),
        (json!({"type": "resume"}), "invalid", "session"),
    ]
}

#[tokio::test]
async fn what_cannot_be_opened_is_told_by_its_field() {
    let server = Server::start().await;
    let mut socket = Socket::to(&server.api()).await;
    for (message, code, field) in wrong_openings().into_iter().chain(wrong_vectors()) {
        let told = socket.ask(message.clone()).await;
        assert_eq!(
            (&told["type"], &told["code"], &told["field"]),
            (&json!("error"), &json!(code), &json!(field)),
            "{message}: {told}"
        );
        assert!(told["detail"].as_str().unwrap().len() > 5 && told["retryable"] == false, "{told}");
    }
    let unknown = socket.ask(opening(json!({"run": "nobody"}))).await;
    assert_eq!(unknown["code"], "unknown_run", "{unknown}");
    socket.text("{").await;
    assert_eq!(socket.told().await["code"], "malformed_json");
    socket.text("{\"type\": \"open\", \"version\": 1, \"version\": 1}").await;
    assert_eq!(socket.told().await["field"], "version");
    socket.bytes(b"SPVF").await;
    assert_eq!(socket.told().await["code"], "not_open");
    assert_eq!(socket.ask(opening(json!({"seed": 1}))).await["type"], "opened");
}

#[tokio::test]
async fn what_cannot_be_done_is_told_and_the_session_goes_on() {
    let server = Server::start().await;
    let api = server.api();
    let (mut socket, _) = Socket::open(&api, json!({"seed": 1})).await;
    for (message, code) in [
        (opening(json!({})), "already_open"),
        (json!({"type": "step", "id": 1}), "invalid"),
        (json!({"type": "step", "id": 1, "action": {"burns": []}, "more": 1}), "invalid"),
        (json!({"type": "step", "id": -1, "action": {"burns": []}}), "invalid"),
        (json!({"type": "step", "id": 1u64 << 60, "action": {"burns": []}}), "invalid"),
        (json!({"type": "step", "id": 1, "action": 7}), "invalid_action"),
        (json!({"type": "reset"}), "invalid"),
        (json!({"type": "jump"}), "unknown_type"),
    ] {
        let told = socket.ask(message.clone()).await;
        assert_eq!((&told["type"], &told["code"]), (&json!("error"), &json!(code)), "{message}: {told}");
    }
    socket.bytes(&[0; 64]).await;
    assert_eq!(socket.told().await["code"], "not_text");
    assert_eq!(socket.step(1, &burn(1)).await["step"], 1);
    // It is a WebSocket or nothing.
    let refused = api.get("/v1/sessions").await;
    assert_eq!(
        (refused.status, &refused.body["type"]),
        (426, &json!("urn:sparring:problem:upgrade_required"))
    );
}
