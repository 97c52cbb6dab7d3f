//! Many environments, by binary frames.

use env_core::batch::{Feed, Seeds};
use env_core::rollout::{read_log, replay};
use env_core::{Recipe, Scenario, log::Precision};
use serde_json::{Value, json};
use system_tests::Server;

use super::client::{Socket, Stepped, Vector, draw};

const ENVS: usize = 5;

fn actions(step: u64, width: usize) -> Vec<f32> {
    (0..width as u64).map(|cell| draw(cell, step) * 1.2 - 0.6).collect()
}

/// The action of one environment in the wire form of kessler.
fn burns(actions: &[f32]) -> Value {
    let burn = |(agent, cells): (usize, &[f32])| json!({"satellite_id": agent, "delta_vx": f64::from(cells[0]), "delta_vy": f64::from(cells[1])});
    json!({"burns": actions.chunks(2).enumerate().map(burn).collect::<Vec<_>>()})
}

/// Own states of the satellites out of an observation in text, as columns.
fn satellites(observation: &Value) -> Vec<f32> {
    let cells = |satellite: &Value| {
        ["x", "y", "vx", "vy", "fuel"].map(|name| satellite[name].as_f64().unwrap() as f32)
    };
    observation["satellites"].as_array().unwrap().iter().flat_map(cells).collect()
}

/// What the columns of environment `env` say of the same.
fn columns(told: &Stepped, env: usize, width: usize) -> Vec<f32> {
    let row = &told.observations[env * width..(env + 1) * width];
    row[..18].chunks(6).flat_map(|satellite| satellite[..5].to_vec()).collect()
}

#[tokio::test]
async fn every_environment_is_a_single_session_bit_for_bit() {
    let server = Server::start().await;
    let api = server.api();
    let params = json!({"debris": 60, "fuel": 30});
    let wish = json!({"task": "eco_station", "params": params, "seed": 77, "vector": {"envs": ENVS}});
    let (mut vector, first) = Vector::open(&api, wish).await;
    let (width, cells) = (vector.width() / ENVS, vector.size("observation"));
    assert_eq!((vector.size("agents"), vector.size("action"), cells), (3, 2, 18 + 5 * 66));
    let names = vector.opened["columns"].as_array().unwrap();
    assert_eq!((names.len(), &names[0], &names[18]), (cells, &json!("satellite_0_x"), &json!("debris_0_x")));
    let task = env_core::task("kessler/eco_station").unwrap();
    let recipe = Recipe::with_params(task, [("debris", 60.0), ("fuel", 30.0)].into_iter()).unwrap();
    let seeds = Seeds::new(recipe, 77);
    let mut singles = Vec::new();
    for env in 0..ENVS {
        let seed = seeds.scenario(env, 0).1.get();
        let wish = json!({"task": "eco_station", "params": params, "seed": seed});
        let (socket, opened) = Socket::open(&api, wish).await;
        assert_eq!(columns(&first, env, cells), satellites(&opened["observation"]), "{env}");
        singles.push((socket, Some(Vec::new()), 0.0, seed));
    }
    for step in 1..=50 {
        let actions = actions(step, vector.width());
        let told = vector.step(&actions).await;
        assert_eq!(told.sequence, step as u32);
        for (env, (socket, flown, total, seed)) in singles.iter_mut().enumerate() {
            let Some(steps) = flown else { continue };
            let action = burns(&actions[env * width..(env + 1) * width]);
            let single = socket.step(step, &action).await;
            steps.push(action["burns"].clone());
            *total += f64::from(told.team_rewards[env]);
            assert_eq!(
                told.team_rewards[env].to_bits(),
                (single["reward"].as_f64().unwrap() as f32).to_bits()
            );
            assert_eq!(columns(&told, env, cells), satellites(&single["observation"]), "{env} at {step}");
            for agent in single["agents"].as_array().unwrap() {
                let at = env * 3 + agent["agent"].as_u64().unwrap() as usize;
                assert_eq!(told.rewards[at].to_bits(), (agent["reward"].as_f64().unwrap() as f32).to_bits());
                assert_eq!(
                    (told.terminated[at] == 1, told.truncated[at] == 1),
                    (agent["terminated"] == true, agent["truncated"] == true)
                );
            }
            assert_eq!(told.flags[env], u8::from(single["done"] == true));
            if single["done"] == true {
                let scenario = json!({"task": "kessler/eco_station", "params": params, "seed": *seed});
                let scenario = Scenario::from_json(&scenario).unwrap();
                let log = read_log(&scenario, steps, Precision::F32, None).unwrap();
                let score = replay(&scenario, &log).unwrap().score;
                assert_eq!(single["score"], json!(score));
                // Fifty rewards in single precision.
                assert!((*total - score).abs() < 1e-5, "{total} {score}");
                *flown = None;
            }
        }
    }
    assert!(singles.iter().all(|single| single.1.is_none()), "fifty steps are an episode");
}

#[tokio::test]
async fn resets_are_gymnasiums() {
    let server = Server::start().await;
    let api = server.api();
    let open = async |autoreset: &str| {
        let wish = json!({"task": "survival", "params": {"debris": 0}, "seed": 5,
                          "vector": {"envs": 2, "autoreset": autoreset, "observe": "tracks", "threats": 2, "look_ahead": 10}});
        Vector::open(&api, wish).await
    };
    for mode in ["next_step", "same_step", "disabled"] {
        let (mut vector, first) = open(mode).await;
        let hold = vec![0.0; vector.width()];
        let mut told = first.clone();
        for _ in 0..50 {
            assert_eq!(told.flags, [0, 0], "{mode}");
            told = vector.step(&hold).await;
        }
        assert_eq!(
            (told.flags.as_slice(), told.truncated.as_slice()),
            ([1, 1].as_slice(), [1; 6].as_slice()),
            "{mode}"
        );
        match mode {
            "next_step" => {
                let begun = vector.step(&hold).await;
                assert_eq!((begun.flags.as_slice(), &begun.team_rewards), ([0, 0].as_slice(), &vec![0.0; 2]));
                assert_ne!(begun.observations, told.observations);
                assert!(vector.step(&hold).await.team_rewards.iter().all(|reward| *reward > 0.0));
            }
            "same_step" => {
                assert_eq!(told.finals.len(), 2 * vector.size("observation"));
                assert_ne!(told.finals, told.observations);
                assert!(vector.step(&hold).await.finals.is_empty());
            }
            _ => {
                let frame = vector.actions(51, &hold);
                vector.socket.bytes(&frame).await;
                let over = vector.socket.told().await;
                assert_eq!((&over["code"], &over["id"]), (&json!("over"), &json!(51)), "{over}");
                let begun = vector.reset(&[0, 1]).await;
                let half = vector.size("observation");
                assert_eq!(begun.observations[..half], told.observations[..half], "the other is as it was");
                assert_ne!(begun.observations[half..], told.observations[half..]);
                let _ = vector.reset(&[1, 0]).await;
                assert_eq!(vector.step(&hold).await.flags, [0, 0]);
            }
        }
    }
}

#[tokio::test]
async fn a_repeated_frame_is_answered_again_and_bad_ones_move_nothing() {
    let server = Server::start().await;
    let wish = json!({"task": "survival", "seed": 1, "vector": {"envs": 3, "observe": "tracks"}});
    let (mut vector, first) = Vector::open(&server.api(), wish.clone()).await;
    let good = actions(1, vector.width());
    let told = vector.step(&good).await;
    let again = vector.actions(1, &good);
    vector.socket.bytes(&again).await;
    let frame = vector.socket.frame().await;
    assert_eq!(vector.read(&frame), told);
    let sent = |at: usize, byte: u8| {
        let mut frame = vector.actions(2, &good);
        frame[at] = byte;
        frame
    };
    let nan = vector.actions(
        2,
        &good.iter().enumerate().map(|(i, x)| if i == 8 { f32::NAN } else { *x }).collect::<Vec<_>>(),
    );
    let infinite = vector.actions(2, &vec![f32::INFINITY; vector.width()]);
    for (frame, code, field) in [
        (Vec::new(), "invalid_frame", "length"),
        (sent(0, b'X')[..7].to_vec(), "invalid_frame", "length"),
        (sent(0, b'X'), "invalid_frame", "magic"),
        (sent(4, 9), "invalid_frame", "version"),
        (sent(6, 2), "invalid_frame", "kind"),
        (sent(12, 4), "invalid_frame", "envs"),
        (sent(8, 4), "out_of_turn", "sequence"),
        (sent(8, 0), "out_of_turn", "sequence"),
        (sent(0, b'S')[..80].to_vec(), "invalid_frame", "length"),
        ([sent(0, b'S'), vec![0; 4]].concat(), "invalid_frame", "length"),
        (nan, "invalid_frame", "actions"),
        (infinite, "invalid_frame", "actions"),
    ] {
        vector.socket.bytes(&frame).await;
        let told = vector.socket.told().await;
        assert_eq!(
            (&told["type"], &told["code"], &told["field"]),
            (&json!("error"), &json!(code), &json!(field)),
            "{told}"
        );
    }
    for text in ["step", "{\"type\": \"step\", \"id\": 2}", "{\"type\": \"open\", \"version\": 1}"] {
        vector.socket.text(text).await;
        let told = vector.socket.told().await;
        assert_eq!(told["type"], "error", "{told}");
    }
    // Nothing has moved: another session that saw none of that is where this one is.
    let (mut clean, same) = Vector::open(&server.api(), wish).await;
    assert_eq!(same, first);
    assert_eq!(clean.step(&good).await, told);
    let next = actions(2, vector.width());
    assert_eq!(vector.step(&next).await, clean.step(&next).await);
    let state = vector.socket.ask(json!({"type": "state"})).await;
    assert_eq!((&state["sequence"], &state["steps"]), (&json!(2), &json!(2)));
}

#[tokio::test]
async fn memory_is_bounded_and_told() {
    let limits = orchestrator::sessions::Limits { memory_mib: 8, ..Default::default() };
    let server =
        Server::set_up(move |config| orchestrator::service::Config { sessions: limits, ..config }).await;
    let api = server.api();
    let wish = |envs: usize| json!({"task": "survival", "vector": {"envs": envs, "observe": "tracks"}});
    let mut socket = Socket::to(&api).await;
    let told = socket.ask(super::client::opening(wish(3000))).await;
    assert_eq!(
        (&told["code"], &told["field"], &told["retryable"]),
        (&json!("invalid"), &json!("vector.envs"), &json!(false)),
        "{told}"
    );
    let (one, _) = Vector::open(&api, wish(200)).await;
    let mut others = Vec::new();
    let full = loop {
        let told = socket.ask(super::client::opening(wish(200))).await;
        if told["type"] == "error" {
            break told;
        }
        let _ = socket.frame().await;
        others.push(std::mem::replace(&mut socket, Socket::to(&api).await));
        assert!(others.len() < 100);
    };
    assert_eq!((&full["code"], &full["retryable"]), (&json!("at_capacity"), &json!(true)), "{full}");
    one.socket.leave().await;
    for _ in 0..200 {
        if socket.ask(super::client::opening(wish(200))).await["type"] == "opened" {
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    }
    panic!("what was freed is not given again");
}
