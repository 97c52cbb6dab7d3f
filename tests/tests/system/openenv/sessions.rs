//! What the original lacks: sessions that last, seeds, a choice of task, and the curriculum.

use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{Api, Server, http_client};

use super::socket::{Came, Socket};

const HOLD: &str = "{\"burns\": []}";

fn hold() -> Value {
    serde_json::from_str(HOLD).unwrap()
}

/// Flies to the end; the last answer.
async fn to_the_end(socket: &mut Socket) -> Value {
    for _ in 0..60 {
        let told = socket.step(hold()).await;
        if told["done"] == true {
            return told;
        }
    }
    panic!("no end");
}

#[tokio::test]
async fn a_seed_is_a_world_and_a_task_can_be_chosen() {
    let server = Server::start().await;
    let mut one = Socket::to(&server.api(), "/ws").await;
    let mut other = Socket::to(&server.api(), "/ws").await;
    let wish = json!({"seed": 42, "task": "rendezvous", "episode_id": "mine"});
    let first = one.reset(wish.clone()).await;
    assert_eq!(first, other.reset(wish).await, "one seed, one world");
    assert!(first["observation"]["mission_objective"].as_str().unwrap().starts_with("RENDEZVOUS"));
    assert_eq!(one.state().await["episode_id"], "mine");
    for _ in 0..5 {
        assert_eq!(one.step(hold()).await, other.step(hold()).await);
    }
    // The episode is the one that the scenario's id says, by the same rules as everywhere.
    let scenario = json!({"scenario": {"task": "kessler/rendezvous", "seed": 42}});
    let checked = server.api().post("/v1/scenarios", scenario).await.expect(200);
    assert_eq!(one.state().await["scenario_id"], checked["scenario_id"]);
    let few = one.reset(json!({"task": "survival", "params": {"debris": 3, "fuel": 7}})).await;
    assert_eq!(few["observation"]["radar_debris"].as_array().unwrap().len(), 3);
    assert_eq!(few["observation"]["satellites"][0]["fuel"], 7.0);
    let docking = one.reset(json!({"task": "docking/multiagent", "seed": 1})).await;
    assert_eq!(docking["observation"]["deputies"].as_array().unwrap().len(), 3);
    let thrust = json!({"thrusts": [{"deputy_id": 0, "thrust_x": 0.5, "thrust_y": 0.0, "thrust_z": 0.0}]});
    assert_eq!(one.step(thrust).await["done"], false);
}

#[tokio::test]
async fn what_cannot_be_is_told_by_its_field_and_the_session_goes_on() {
    let server = Server::start().await;
    let mut socket = Socket::to(&server.api(), "/ws").await;
    let evaluation = (1u64 << 52) + 5;
    for (data, at) in [
        (json!({"seed": evaluation}), vec!["seed"]),
        (json!({"seed": "x"}), vec!["seed"]),
        (json!({"task": "chess"}), vec!["task"]),
        (json!({"task": 4}), vec!["task"]),
        (json!({"params": {"fuel": -1}}), vec!["params", "fuel"]),
        (json!({"params": {"fule": 1}}), vec!["params", "fule"]),
        (json!({"params": [1]}), vec!["params"]),
        (json!({"physics": {"gravity": "up"}}), vec!["physics", "gravity"]),
        (json!({"scenario": {"task": "kessler/survival", "seed": evaluation}}), vec!["scenario", "seed"]),
        (json!({"scenario": {"task": "kessler/survival", "seed": 1}, "seed": 2}), vec!["seed"]),
        (json!({"run": "r", "seed": 2}), vec!["seed"]),
        (json!({"run": "NO"}), vec!["run"]),
        (json!({"lease_id": "7-abcdef"}), vec!["run"]),
        (json!({"group_id": "x".repeat(256)}), vec!["group_id"]),
        (json!({"episode_id": 7}), vec!["episode_id"]),
    ] {
        let told = socket.ask(&json!({"type": "reset", "data": data})).await;
        assert_eq!(told["data"]["code"], "VALIDATION_ERROR", "{data}: {told}");
        assert_eq!(told["data"]["errors"][0]["loc"], json!(at), "{data}: {told}");
        let refused = server.api().post("/reset", data.clone()).await;
        assert_eq!(refused.status, 422, "{data}");
        let mut loc = vec!["body"];
        loc.extend(at);
        assert_eq!(refused.body["detail"][0]["loc"], json!(loc), "{data}");
    }
    let told = socket.ask(&json!({"type": "reset", "data": {"run": "nobody"}})).await;
    assert_eq!(told["data"]["code"], "EXECUTION_ERROR", "{told}");
    let _ = socket.reset(json!({})).await;
    let last = to_the_end(&mut socket).await;
    assert!(last["observation"]["total_score"].as_f64().is_some());
    let over = socket.ask(&json!({"type": "step", "data": hold()})).await;
    assert_eq!(over["data"]["code"], "EXECUTION_ERROR", "{over}");
    let _ = socket.reset(json!({})).await;
}

#[tokio::test]
async fn requests_share_an_environment_or_have_their_own() {
    let server = Server::start().await;
    let api = server.api();
    assert_eq!(api.post("/step", json!({"burns": []})).await.status, 409);
    let first = api.post("/reset", json!({"seed": 7})).await.expect(200);
    let stepped = api.post("/step", json!({"burns": []})).await.expect(200);
    assert_ne!(first["observation"]["satellites"], stepped["observation"]["satellites"]);
    assert_eq!(api.get("/state").await.expect(200)["step_count"], 1);
    let own = http_client()
        .post(format!("{}/reset", api.base()))
        .header("x-session-id", "own")
        .json(&json!({"seed": 7}));
    assert_eq!(own.send().await.unwrap().json::<Value>().await.unwrap(), first);
    assert_eq!(api.get("/state").await.expect(200)["step_count"], 1, "the shared one is left alone");
    let long = http_client().get(format!("{}/state", api.base())).header("x-session-id", "x".repeat(300));
    assert_eq!(long.send().await.unwrap().status(), 400);
}

/// Only what flies takes a place.
#[tokio::test]
async fn looking_and_being_refused_take_nobodys_place() {
    let sessions = orchestrator::sessions::Limits { most: 2, ..Default::default() };
    let server = Server::set_up(move |config| Config { sessions, ..config }).await;
    let api = server.api();
    for name in 0..8 {
        let named =
            |request: reqwest::RequestBuilder| request.header("x-session-id", format!("n{name}")).send();
        let state = named(http_client().get(format!("{}/state", api.base()))).await.unwrap();
        assert_eq!(state.json::<Value>().await.unwrap()["step_count"], 0);
        for wish in [json!({"seed": -1}), json!({"run": "none"}), json!({"params": {"debris": -4}})] {
            let reset = named(http_client().post(format!("{}/reset", api.base())).json(&wish)).await.unwrap();
            assert!([404, 422].contains(&reset.status().as_u16()), "{wish}");
        }
    }
    let mut socket = Socket::to(&api, "/ws").await;
    socket.reset(json!({})).await;
    let _ = api.post("/reset", json!({})).await.expect(200);
    let full = api.raw("POST", "/web/reset", "application/json", "{}").await;
    assert_eq!(full.status, 503, "both places are taken now");
}

#[tokio::test]
async fn a_group_is_one_scenario() {
    let server = Server::start().await;
    let api = server.api();
    let (mut one, mut other) = (Socket::to(&api, "/ws").await, Socket::to(&api, "/ws").await);
    let wish = json!({"group_id": "g1"});
    let first = one.reset(wish.clone()).await;
    assert_eq!(first, one.reset(wish.clone()).await);
    assert_eq!(first, other.reset(wish).await);
    assert_ne!(first, other.reset(json!({"group_id": "g2"})).await);
    let both = one.ask(&json!({"type": "reset", "data": {"group_id": "g1", "seed": 5}})).await;
    assert_eq!(both["data"]["errors"][0]["loc"], json!(["seed"]), "{both}");
}

async fn run(api: &Api) {
    let wish = json!({"id": "run", "seed": 3, "placement": false, "tasks": ["kessler/survival"], "group_size": 2,
                      "contested_share": 0.0});
    let _ = api.post("/v1/runs", wish).await.expect(201);
}

async fn episodes(api: &Api) -> Vec<Value> {
    api.get("/v1/runs/run/episodes?limit=500").await.expect(200)["episodes"].as_array().unwrap().clone()
}

#[tokio::test]
async fn a_session_flies_what_the_curriculum_proposes_and_reports_it() {
    let server = Server::start().await;
    let api = server.api();
    run(&api).await;
    let mut socket = Socket::to(&api, "/ws").await;
    let _ = socket.reset(json!({"run": "run", "policy_version": 4})).await;
    let state = socket.state().await;
    assert_eq!((&state["run"], &state["reported"]), (&json!("run"), &Value::Null));
    let last = to_the_end(&mut socket).await;
    // Answered once it is on disk.
    let flown = episodes(&api).await;
    assert_eq!(flown.len(), 1, "{flown:?}");
    let state = socket.state().await;
    assert_eq!((&flown[0]["episode"], &flown[0]["policy_version"]), (&state["episode_id"], &json!(4)));
    let total = last["observation"]["total_score"].as_f64().unwrap();
    let score = flown[0]["score"].as_f64().unwrap();
    // The score is the total clamped into (0, 1).
    assert!((total - score).abs() < 1e-3, "{total} {score}");
    assert_eq!(state["reported"]["status"], "counted", "{state}");
    let leases = api.get("/v1/runs/run/leases").await.expect(200);
    assert_eq!(leases["leases"][0]["status"], "done");
    // Siblings of a group have one scenario, wherever they fly; there are as many as the group has episodes.
    let (mut one, mut other) = (Socket::to(&api, "/ws").await, Socket::to(&api, "/ws").await);
    let wish = json!({"run": "run", "group_id": "a"});
    let first = one.reset(wish.clone()).await;
    assert_eq!(first, other.reset(wish.clone()).await);
    let full = Socket::to(&api, "/ws").await.ask(&json!({"type": "reset", "data": wish})).await;
    assert!(full["data"]["message"].as_str().unwrap().contains("group_id"), "{full}");
    let _ = to_the_end(&mut one).await;
    let _ = to_the_end(&mut other).await;
    assert_eq!(episodes(&api).await.len(), 3);
}

#[tokio::test]
async fn a_trainers_lease_can_be_flown_here() {
    let server = Server::start().await;
    let api = server.api();
    run(&api).await;
    let lease = api.lease("run", json!({"groups": 2})).await;
    let id = lease.0["lease"].as_str().unwrap().to_owned();
    let named = lease.0["groups"][1]["episodes"][1].as_str().unwrap();
    let mut socket = Socket::to(&api, "/ws").await;
    let _ = socket.reset(json!({"run": "run", "lease_id": id, "episode_id": named})).await;
    let state = socket.state().await;
    assert_eq!(
        (&state["episode_id"], &state["scenario_id"]),
        (&json!(named), &lease.0["groups"][1]["scenario"])
    );
    let _ = to_the_end(&mut socket).await;
    for _ in 0..3 {
        let _ = socket.reset(json!({"run": "run", "lease_id": id})).await;
        let _ = to_the_end(&mut socket).await;
    }
    assert_eq!(api.get(&format!("/v1/runs/run/leases/{id}")).await.expect(200)["status"], "done");
    let over = socket.ask(&json!({"type": "reset", "data": {"run": "run", "lease_id": id}})).await;
    assert!(over["data"]["message"].as_str().unwrap().contains("lease"), "{over}");
}

#[tokio::test]
async fn who_drops_out_leaves_nothing_behind() {
    let server = Server::start().await;
    let api = server.api();
    run(&api).await;
    let mut socket = Socket::to(&api, "/ws").await;
    let _ = socket.reset(json!({"run": "run"})).await;
    let _ = socket.step(hold()).await;
    socket.drop_dead();
    for _ in 0..200 {
        let leases = api.get("/v1/runs/run/leases").await.expect(200);
        if leases["leases"][0]["status"] == "released" {
            assert!(episodes(&api).await.is_empty());
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    }
    panic!("the lease is still held");
}

#[tokio::test]
async fn thirty_two_fly_at_once_and_the_server_stops_in_good_order() {
    let mut server = Server::start().await;
    let api = server.api();
    let flights = (0..32).map(|seed| {
        let api = api.clone();
        tokio::spawn(async move {
            let mut socket = Socket::to(&api, "/ws").await;
            let first = socket.reset(json!({"seed": seed, "task": "survival"})).await;
            (first, to_the_end(&mut socket).await)
        })
    });
    let mut worlds = Vec::new();
    for flight in flights.collect::<Vec<_>>() {
        let (first, last) = flight.await.unwrap();
        assert_eq!(last["done"], true);
        worlds.push(first.to_string());
    }
    worlds.sort_unstable();
    worlds.dedup();
    assert_eq!(worlds.len(), 32);
    let mut open = Socket::to(&api, "/ws").await;
    let _ = open.reset(json!({})).await;
    server.stop().await;
    assert!(matches!(open.next().await, Came::Frame(told) if told["data"]["code"] == "SESSION_ERROR"));
    assert_eq!(open.next().await, Came::Closed(1000));
}

#[tokio::test]
async fn a_silent_session_is_closed() {
    let idle = Some(std::time::Duration::from_millis(200));
    let sessions = orchestrator::sessions::Limits { most: 4, idle, ..Default::default() };
    let server = Server::set_up(move |config| Config { sessions, ..config }).await;
    let mut socket = Socket::to(&server.api(), "/ws").await;
    assert!(matches!(socket.next().await, Came::Frame(told) if told["data"]["code"] == "SESSION_TIMEOUT"));
    assert_eq!(socket.next().await, Came::Closed(1000));
}

/// What comes after the beginning of such a frame cannot be told apart: the socket ends, and nothing else does.
#[tokio::test]
async fn a_frame_that_is_too_large_ends_its_session() {
    let server = Server::start().await;
    let mut other = Socket::to(&server.api(), "/ws").await;
    other.reset(json!({"seed": 1})).await;
    for path in ["/ws", "/mcp"] {
        let mut socket = Socket::to(&server.api(), path).await;
        socket.text(&format!("\"{}\"", " ".repeat(3 << 20))).await;
        assert!(matches!(socket.next().await, Came::Frame(_)), "{path}: 3 MiB are read");
        // Who is still sending when the server ends it may find the connection cut instead of the code.
        let cut = !socket.try_text(&" ".repeat(5 << 20)).await;
        assert!(matches!(socket.next().await, Came::Closed(code) if code == 1009 || cut), "{path}");
    }
    other.step(hold()).await;
}

#[tokio::test]
async fn an_agent_plays_through_tools_and_cannot_begin_again() {
    let server = Server::start().await;
    let api = server.api();
    let call = async |method: &str, params: Value| {
        let request = json!({"jsonrpc": "2.0", "id": 1, "method": method, "params": params});
        api.post("/mcp", request).await.expect(200)
    };
    let created = call("openenv/session/create", json!({"task": "survival", "seed": 5})).await;
    let session = created["result"]["session_id"].as_str().unwrap().to_owned();
    let listed = call("tools/list", json!({"session_id": session})).await;
    let names: Vec<&str> = listed["result"]["tools"]
        .as_array()
        .unwrap()
        .iter()
        .map(|tool| tool["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["fire_thrusters", "hold", "telemetry", "conjunctions"]);
    let tool = async |name: &str, arguments: Value| {
        call("tools/call", json!({"session_id": session, "name": name, "arguments": arguments})).await
    };
    let seen = tool("telemetry", json!({})).await;
    assert_eq!(seen["result"]["data"]["step"], 0);
    let foreseen = tool("conjunctions", json!({})).await;
    assert!(foreseen["result"]["data"]["conjunctions"].is_array(), "{foreseen}");
    let burns = json!({"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0}]});
    let burnt = tool("fire_thrusters", burns).await;
    let fuel =
        |told: &Value| told["result"]["data"]["observation"]["satellites"][0]["fuel"].as_f64().unwrap();
    assert!(fuel(&burnt) < fuel(&seen), "{burnt}");
    let wrong = tool("fire_thrusters", json!({"burns": [{"satellite_id": 0}]})).await;
    assert_eq!(wrong["error"]["code"], -32602);
    assert!(wrong["error"]["message"].as_str().unwrap().contains("burns.0.delta_vx"), "{wrong}");
    let last = tool("hold", json!({"steps": 60})).await;
    assert_eq!(last["result"]["data"]["done"], true);
    let over = tool("hold", json!({})).await;
    assert_eq!(over["error"]["code"], -32603, "{over}");
    let text = format!("{seen}{foreseen}{burnt}{last}");
    assert!(!text.contains("witness") && !text.contains("reference"), "the plan is not theirs to see");
    assert_eq!(tool("reset", json!({})).await["error"]["code"], -32602);
}

/// Over a socket of its own, an agent's session is the connection's: begun as it asks, and again once it is over.
#[tokio::test]
async fn a_connection_plays_one_episode_after_another() {
    let server = Server::start().await;
    let mut socket = Socket::to(&server.api(), "/mcp").await;
    let mut call = async |method: &str, params: Value| {
        socket.ask(&json!({"jsonrpc": "2.0", "id": 1, "method": method, "params": params})).await
    };
    for refused in [json!({"task": "nope"}), json!({"seed": -1}), json!({"run": "none"})] {
        let told = call("openenv/session/create", refused.clone()).await;
        assert!(told["error"]["code"].is_i64(), "{refused}: {told}");
    }
    let created = call("openenv/session/create", json!({"task": "rendezvous", "seed": 2})).await;
    let own = created["result"]["session_id"].as_str().unwrap().to_owned();
    let wish = json!({"session_id": own, "name": "telemetry", "arguments": {}});
    let seen = call("tools/call", wish).await;
    assert!(seen.to_string().contains("RENDEZVOUS"), "{seen}");
    let another = call("openenv/session/create", json!({"task": "survival"})).await;
    assert_eq!(another["error"]["code"], -32602, "one flies: {another}");
    assert_eq!(call("openenv/session/create", json!({})).await["result"]["session_id"], own.as_str());
    let close = call("openenv/session/close", json!({"session_id": own})).await;
    assert_eq!(close["error"]["code"], -32602, "{close}");
    let hold = json!({"name": "hold", "arguments": {"steps": 60}});
    assert_eq!(call("tools/call", hold.clone()).await["result"]["data"]["done"], true);
    assert_eq!(call("tools/call", hold.clone()).await["error"]["code"], -32603);
    let again = call("openenv/session/create", json!({"task": "survival", "seed": 3})).await;
    assert_eq!(again["result"]["session_id"], own.as_str());
    assert_eq!(call("tools/call", hold).await["result"]["data"]["done"], true);
}
