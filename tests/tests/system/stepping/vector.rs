//! Vector sessions: many environments with binary frames.

use env_core::batch::{ScenarioSource, SeedSequence};
use env_core::rollout::{read_log, replay};
use env_core::{Recipe, Scenario, log::Precision};
use serde_json::{Value, json};
use system_tests::{Server, wait_until};

use super::client::{SessionSocket, StepFrame, VectorSession, open_message, uniform};

const ENVS: usize = 5;

fn actions(step: u64, width: usize) -> Vec<f32> {
    (0..width as u64).map(|cell| uniform(cell, step) * 1.2 - 0.6).collect()
}

/// Converts the actions of one environment to the JSON form of kessler.
fn burns(actions: &[f32]) -> Value {
    let burn = |(agent, delta_v): (usize, &[f32])| json!({"satellite_id": agent, "delta_vx": f64::from(delta_v[0]), "delta_vy": f64::from(delta_v[1])});
    json!({"burns": actions.chunks(2).enumerate().map(burn).collect::<Vec<_>>()})
}

/// Returns the satellites of a JSON observation as columns.
fn satellites(observation: &Value) -> Vec<f32> {
    let columns = |satellite: &Value| {
        ["x", "y", "vx", "vy", "fuel"].map(|name| satellite[name].as_f64().unwrap() as f32)
    };
    observation["satellites"].as_array().unwrap().iter().flat_map(columns).collect()
}

/// Returns the satellites of environment `env` from the columns of a frame.
fn columns(reply: &StepFrame, env: usize, width: usize) -> Vec<f32> {
    let row = &reply.observations[env * width..(env + 1) * width];
    row[..18].chunks(6).flat_map(|satellite| satellite[..5].to_vec()).collect()
}

/// Single session with the scenario of one slot of a vector session.
struct SingleSession {
    socket: SessionSocket,
    seed: u64,
    /// Burns of the episode so far.
    burns: Vec<Value>,
    /// Sum of the team rewards that the vector session returned.
    total_reward: f64,
    is_done: bool,
}

fn eco_station_params() -> Value {
    json!({"debris": 60, "fuel": 30})
}

#[tokio::test]
async fn vector_session_equals_single_sessions_bit_for_bit() {
    let server = Server::start().await;
    let api = server.api();
    let options =
        json!({"task": "eco_station", "params": eco_station_params(), "seed": 77, "vector": {"envs": ENVS}});
    let (mut vector, first) = VectorSession::open(&api, options).await;
    let (width, observation_len) = (vector.action_len() / ENVS, vector.opened_number("observation"));
    assert_eq!(
        (vector.opened_number("agents"), vector.opened_number("action"), observation_len),
        (3, 2, 18 + 5 * 66)
    );
    let names = vector.opened["columns"].as_array().unwrap();
    assert_eq!(
        (names.len(), &names[0], &names[18]),
        (observation_len, &json!("satellite_0_x"), &json!("debris_0_x"))
    );
    let task = env_core::task("kessler/eco_station").unwrap();
    let recipe = Recipe::with_params(task, [("debris", 60.0), ("fuel", 30.0)].into_iter()).unwrap();
    let seeds = SeedSequence::new(recipe, 77);
    let mut singles = Vec::new();
    for env in 0..ENVS {
        let seed = seeds.scenario(env, 0).seed().get();
        let options = json!({"task": "eco_station", "params": eco_station_params(), "seed": seed});
        let (socket, opened) = SessionSocket::open(&api, options).await;
        assert_eq!(columns(&first, env, observation_len), satellites(&opened["observation"]), "{env}");
        singles.push(SingleSession { socket, seed, burns: Vec::new(), total_reward: 0.0, is_done: false });
    }
    for step in 1..=50 {
        let actions = actions(step, vector.action_len());
        let frame = vector.step(&actions).await;
        assert_eq!(frame.sequence, step as u32);
        for (env, single) in singles.iter_mut().enumerate().filter(|(_, single)| !single.is_done) {
            let action = burns(&actions[env * width..(env + 1) * width]);
            let reply = single.socket.step(step, &action).await;
            single.burns.push(action["burns"].clone());
            single.total_reward += f64::from(frame.team_rewards[env]);
            assert_eq!(
                columns(&frame, env, observation_len),
                satellites(&reply["observation"]),
                "{env} at {step}"
            );
            assert_same_step(&frame, env, &reply);
            if reply["done"] == true {
                assert_replayed_score(single, &reply["score"]);
                single.is_done = true;
            }
        }
    }
    assert!(singles.iter().all(|single| single.is_done), "an episode has at most fifty steps");
}

/// Compares rewards and flags of slot `env` with the reply of its single session.
fn assert_same_step(frame: &StepFrame, env: usize, reply: &Value) {
    let bits = |value: &Value| (value.as_f64().unwrap() as f32).to_bits();
    assert_eq!(frame.team_rewards[env].to_bits(), bits(&reply["reward"]));
    for agent in reply["agents"].as_array().unwrap() {
        let at = env * 3 + agent["agent"].as_u64().unwrap() as usize;
        assert_eq!(frame.rewards[at].to_bits(), bits(&agent["reward"]));
        assert_eq!(
            (frame.terminated[at] == 1, frame.truncated[at] == 1),
            (agent["terminated"] == true, agent["truncated"] == true)
        );
    }
    assert_eq!(frame.flags[env], u8::from(reply["done"] == true));
}

fn assert_replayed_score(single: &SingleSession, reported_score: &Value) {
    let scenario =
        json!({"task": "kessler/eco_station", "params": eco_station_params(), "seed": single.seed});
    let scenario = Scenario::from_json(&scenario).unwrap();
    let log = read_log(&scenario, &single.burns, Precision::F32, None).unwrap();
    let score = replay(&scenario, &log).unwrap().score;
    assert_eq!(*reported_score, json!(score));
    // Sum of fifty rewards in single precision.
    assert!((single.total_reward - score).abs() < 1e-5, "{} {score}", single.total_reward);
}

#[tokio::test]
async fn autoreset_modes_follow_gymnasium() {
    let server = Server::start().await;
    let api = server.api();
    let open = async |autoreset: &str| {
        let options = json!({"task": "survival", "params": {"debris": 0}, "seed": 5,
                          "vector": {"envs": 2, "autoreset": autoreset, "observe": "tracks", "threats": 2, "look_ahead": 10}});
        VectorSession::open(&api, options).await
    };
    for mode in ["next_step", "same_step", "disabled"] {
        let (mut vector, first) = open(mode).await;
        let hold = vec![0.0; vector.action_len()];
        let mut reply = first.clone();
        for _ in 0..50 {
            assert_eq!(reply.flags, [0, 0], "{mode}");
            reply = vector.step(&hold).await;
        }
        assert_eq!(
            (reply.flags.as_slice(), reply.truncated.as_slice()),
            ([1, 1].as_slice(), [1; 6].as_slice()),
            "{mode}"
        );
        match mode {
            "next_step" => {
                let restarted = vector.step(&hold).await;
                assert_eq!(
                    (restarted.flags.as_slice(), &restarted.team_rewards),
                    ([0, 0].as_slice(), &vec![0.0; 2])
                );
                assert_ne!(restarted.observations, reply.observations);
                assert!(vector.step(&hold).await.team_rewards.iter().all(|reward| *reward > 0.0));
            }
            "same_step" => {
                assert_eq!(reply.final_observations.len(), 2 * vector.opened_number("observation"));
                assert_ne!(reply.final_observations, reply.observations);
                assert!(vector.step(&hold).await.final_observations.is_empty());
            }
            _ => {
                let frame = vector.action_frame(51, &hold);
                vector.socket.send_bytes(&frame).await;
                let error = vector.socket.receive_text().await;
                assert_eq!((&error["code"], &error["id"]), (&json!("episode_over"), &json!(51)), "{error}");
                let restarted = vector.reset(&[0, 1]).await;
                let half = vector.opened_number("observation");
                assert_eq!(
                    restarted.observations[..half],
                    reply.observations[..half],
                    "the other environment is unchanged"
                );
                assert_ne!(restarted.observations[half..], reply.observations[half..]);
                let _ = vector.reset(&[1, 0]).await;
                assert_eq!(vector.step(&hold).await.flags, [0, 0]);
            }
        }
    }
}

#[tokio::test]
async fn repeated_frame_repeats_the_reply_and_invalid_ones_do_nothing() {
    let server = Server::start().await;
    let options = json!({"task": "survival", "seed": 1, "vector": {"envs": 3, "observe": "tracks"}});
    let (mut vector, first) = VectorSession::open(&server.api(), options.clone()).await;
    let valid = actions(1, vector.action_len());
    let reply = vector.step(&valid).await;
    let repeated = vector.action_frame(1, &valid);
    vector.socket.send_bytes(&repeated).await;
    let frame = vector.socket.receive_bytes().await;
    assert_eq!(vector.decode(&frame), reply);
    let modified = |at: usize, byte: u8| {
        let mut frame = vector.action_frame(2, &valid);
        frame[at] = byte;
        frame
    };
    let nan = vector.action_frame(
        2,
        &valid.iter().enumerate().map(|(i, x)| if i == 8 { f32::NAN } else { *x }).collect::<Vec<_>>(),
    );
    let infinite = vector.action_frame(2, &vec![f32::INFINITY; vector.action_len()]);
    for (frame, code, field) in [
        (Vec::new(), "invalid_frame", "length"),
        (modified(0, b'X')[..7].to_vec(), "invalid_frame", "length"),
        (modified(0, b'X'), "invalid_frame", "magic"),
        (modified(4, 9), "invalid_frame", "version"),
        (modified(6, 2), "invalid_frame", "kind"),
        (modified(12, 4), "invalid_frame", "envs"),
        (modified(8, 4), "out_of_order", "sequence"),
        (modified(8, 0), "out_of_order", "sequence"),
        (modified(0, b'S')[..80].to_vec(), "invalid_frame", "length"),
        ([modified(0, b'S'), vec![0; 4]].concat(), "invalid_frame", "length"),
        (nan, "invalid_frame", "actions"),
        (infinite, "invalid_frame", "actions"),
    ] {
        vector.socket.send_bytes(&frame).await;
        let reply = vector.socket.receive_text().await;
        assert_eq!(
            (&reply["type"], &reply["code"], &reply["field"]),
            (&json!("error"), &json!(code), &json!(field)),
            "{reply}"
        );
    }
    for text in ["step", "{\"type\": \"step\", \"id\": 2}", "{\"type\": \"open\", \"version\": 1}"] {
        vector.socket.send_text(text).await;
        let reply = vector.socket.receive_text().await;
        assert_eq!(reply["type"], "error", "{reply}");
    }
    // The session is in the same state as one that received no invalid frames.
    let (mut clean, same_first) = VectorSession::open(&server.api(), options).await;
    assert_eq!(same_first, first);
    assert_eq!(clean.step(&valid).await, reply);
    let next = actions(2, vector.action_len());
    assert_eq!(vector.step(&next).await, clean.step(&next).await);
    let state = vector.socket.request(&json!({"type": "state"})).await;
    assert_eq!((&state["sequence"], &state["steps"]), (&json!(2), &json!(2)));
}

#[tokio::test]
async fn vector_memory_is_bounded_and_reused() {
    let limits = orchestrator::sessions::SessionLimits { memory_mib: 8, ..Default::default() };
    let server =
        Server::with_config(move |config| orchestrator::service::Config { sessions: limits, ..config }).await;
    let api = server.api();
    let options = |envs: usize| json!({"task": "survival", "vector": {"envs": envs, "observe": "tracks"}});
    let mut socket = SessionSocket::connect(&api).await;
    let reply = socket.request(&open_message(options(3000))).await;
    assert_eq!(
        (&reply["code"], &reply["field"], &reply["retryable"]),
        (&json!("invalid"), &json!("vector.envs"), &json!(false)),
        "{reply}"
    );
    let (one, _) = VectorSession::open(&api, options(200)).await;
    let mut others = Vec::new();
    let full = loop {
        let reply = socket.request(&open_message(options(200))).await;
        if reply["type"] == "error" {
            break reply;
        }
        let _ = socket.receive_bytes().await;
        others.push(std::mem::replace(&mut socket, SessionSocket::connect(&api).await));
        assert!(others.len() < 100);
    };
    assert_eq!((&full["code"], &full["retryable"]), (&json!("at_capacity"), &json!(true)), "{full}");
    one.socket.close().await;
    wait_until("the freed memory is available", async || {
        socket.request(&open_message(options(200))).await["type"] == "opened"
    })
    .await;
}
