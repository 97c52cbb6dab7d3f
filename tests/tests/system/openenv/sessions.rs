//! Features beyond the original kessler-env: seeds, choice of task, named sessions, episodes of runs, and tools.

use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{ApiClient, Received, Server, http_client, wait_until};

use super::socket::OpenEnvSocket;

const HOLD_ACTION: &str = "{\"burns\": []}";

fn hold() -> Value {
    serde_json::from_str(HOLD_ACTION).unwrap()
}

/// Holds until the episode ends and returns the last observation.
async fn hold_to_the_end(socket: &mut OpenEnvSocket) -> Value {
    for _ in 0..60 {
        let reply = socket.step(hold()).await;
        if reply["done"] == true {
            return reply;
        }
    }
    panic!("no end");
}

#[tokio::test]
async fn seed_and_task_determine_the_episode() {
    let server = Server::start().await;
    let mut one = OpenEnvSocket::connect(&server.api(), "/ws").await;
    let mut other = OpenEnvSocket::connect(&server.api(), "/ws").await;
    let request = json!({"seed": 42, "task": "rendezvous", "episode_id": "mine"});
    let first = one.reset(request.clone()).await;
    assert_eq!(first, other.reset(request).await, "equal seeds give equal episodes");
    assert!(first["observation"]["mission_objective"].as_str().unwrap().starts_with("RENDEZVOUS"));
    assert_eq!(one.state().await["episode_id"], "mine");
    for _ in 0..5 {
        assert_eq!(one.step(hold()).await, other.step(hold()).await);
    }
    // The scenario id equals that of `/v1/scenarios`.
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
async fn invalid_reset_names_its_field_and_keeps_the_session() {
    let server = Server::start().await;
    let mut socket = OpenEnvSocket::connect(&server.api(), "/ws").await;
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
        let reply = socket.request(&json!({"type": "reset", "data": data})).await;
        assert_eq!(reply["data"]["code"], "VALIDATION_ERROR", "{data}: {reply}");
        assert_eq!(reply["data"]["errors"][0]["loc"], json!(at), "{data}: {reply}");
        let refused = server.api().post("/reset", data.clone()).await;
        assert_eq!(refused.status, 422, "{data}");
        let mut loc = vec!["body"];
        loc.extend(at);
        assert_eq!(refused.body["detail"][0]["loc"], json!(loc), "{data}");
    }
    let reply = socket.request(&json!({"type": "reset", "data": {"run": "unknown"}})).await;
    assert_eq!(reply["data"]["code"], "EXECUTION_ERROR", "{reply}");
    let _ = socket.reset(json!({})).await;
    let last = hold_to_the_end(&mut socket).await;
    assert!(last["observation"]["total_score"].as_f64().is_some());
    let error = socket.request(&json!({"type": "step", "data": hold()})).await;
    assert_eq!(error["data"]["code"], "EXECUTION_ERROR", "{error}");
    let _ = socket.reset(json!({})).await;
}

#[tokio::test]
async fn http_requests_share_an_environment_unless_named() {
    let server = Server::start().await;
    let api = server.api();
    assert_eq!(api.post("/step", json!({"burns": []})).await.status, 409);
    let first = api.post("/reset", json!({"seed": 7})).await.expect(200);
    let stepped = api.post("/step", json!({"burns": []})).await.expect(200);
    assert_ne!(first["observation"]["satellites"], stepped["observation"]["satellites"]);
    assert_eq!(api.get("/state").await.expect(200)["step_count"], 1);
    let session = http_client()
        .post(format!("{}/reset", api.base()))
        .header("x-session-id", "own")
        .json(&json!({"seed": 7}));
    assert_eq!(session.send().await.unwrap().json::<Value>().await.unwrap(), first);
    assert_eq!(api.get("/state").await.expect(200)["step_count"], 1, "the shared environment is unchanged");
    let long = http_client().get(format!("{}/state", api.base())).header("x-session-id", "x".repeat(300));
    assert_eq!(long.send().await.unwrap().status(), 400);
}

/// Only environments with an episode count towards the limit.
#[tokio::test]
async fn state_and_rejected_resets_use_no_place() {
    let sessions = orchestrator::sessions::SessionLimits { max_sessions: 2, ..Default::default() };
    let server = Server::with_config(move |config| Config { sessions, ..config }).await;
    let api = server.api();
    for name in 0..8 {
        let named =
            |request: reqwest::RequestBuilder| request.header("x-session-id", format!("n{name}")).send();
        let state = named(http_client().get(format!("{}/state", api.base()))).await.unwrap();
        assert_eq!(state.json::<Value>().await.unwrap()["step_count"], 0);
        for request in [json!({"seed": -1}), json!({"run": "none"}), json!({"params": {"debris": -4}})] {
            let reset =
                named(http_client().post(format!("{}/reset", api.base())).json(&request)).await.unwrap();
            assert!([404, 422].contains(&reset.status().as_u16()), "{request}");
        }
    }
    let mut socket = OpenEnvSocket::connect(&api, "/ws").await;
    socket.reset(json!({})).await;
    let _ = api.post("/reset", json!({})).await.expect(200);
    let full = api.request("POST", "/web/reset", "application/json", "{}").await;
    assert_eq!(full.status, 503, "both places are taken");
}

#[tokio::test]
async fn group_id_selects_one_scenario() {
    let server = Server::start().await;
    let api = server.api();
    let (mut one, mut other) =
        (OpenEnvSocket::connect(&api, "/ws").await, OpenEnvSocket::connect(&api, "/ws").await);
    let request = json!({"group_id": "g1"});
    let first = one.reset(request.clone()).await;
    assert_eq!(first, one.reset(request.clone()).await);
    assert_eq!(first, other.reset(request).await);
    assert_ne!(first, other.reset(json!({"group_id": "g2"})).await);
    let both = one.request(&json!({"type": "reset", "data": {"group_id": "g1", "seed": 5}})).await;
    assert_eq!(both["data"]["errors"][0]["loc"], json!(["seed"]), "{both}");
}

async fn create_run(api: &ApiClient) {
    let request = json!({"id": "run", "seed": 3, "placement": false, "tasks": ["kessler/survival"], "group_size": 2,
                      "contested_share": 0.0});
    let _ = api.post("/v1/runs", request).await.expect(201);
}

async fn episodes(api: &ApiClient) -> Vec<Value> {
    api.get("/v1/runs/run/episodes?limit=500").await.expect(200)["episodes"].as_array().unwrap().clone()
}

#[tokio::test]
async fn session_runs_and_reports_episodes_of_a_run() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api).await;
    let mut socket = OpenEnvSocket::connect(&api, "/ws").await;
    let _ = socket.reset(json!({"run": "run", "policy_version": 4})).await;
    let state = socket.state().await;
    assert_eq!((&state["run"], &state["reported"]), (&json!("run"), &Value::Null));
    let last = hold_to_the_end(&mut socket).await;
    // The result is stored before the reply is sent.
    let stored = episodes(&api).await;
    assert_eq!(stored.len(), 1, "{stored:?}");
    let state = socket.state().await;
    assert_eq!((&stored[0]["episode"], &stored[0]["policy_version"]), (&state["episode_id"], &json!(4)));
    let total = last["observation"]["total_score"].as_f64().unwrap();
    let score = stored[0]["score"].as_f64().unwrap();
    // The score is the total clamped into (0, 1).
    assert!((total - score).abs() < 1e-3, "{total} {score}");
    assert_eq!(state["reported"]["status"], "counted", "{state}");
    let leases = api.get("/v1/runs/run/leases").await.expect(200);
    assert_eq!(leases["leases"][0]["status"], "done");
    // Sessions with the same group id share a scenario; their number is the size of the group.
    let (mut one, mut other) =
        (OpenEnvSocket::connect(&api, "/ws").await, OpenEnvSocket::connect(&api, "/ws").await);
    let request = json!({"run": "run", "group_id": "a"});
    let first = one.reset(request.clone()).await;
    assert_eq!(first, other.reset(request.clone()).await);
    let full =
        OpenEnvSocket::connect(&api, "/ws").await.request(&json!({"type": "reset", "data": request})).await;
    assert!(full["data"]["message"].as_str().unwrap().contains("group_id"), "{full}");
    let _ = hold_to_the_end(&mut one).await;
    let _ = hold_to_the_end(&mut other).await;
    assert_eq!(episodes(&api).await.len(), 3);
}

#[tokio::test]
async fn session_runs_episodes_of_a_lease() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api).await;
    let lease = api.lease("run", json!({"groups": 2})).await;
    let id = lease.0["lease"].as_str().unwrap().to_owned();
    let named = lease.0["groups"][1]["episodes"][1].as_str().unwrap();
    let mut socket = OpenEnvSocket::connect(&api, "/ws").await;
    let _ = socket.reset(json!({"run": "run", "lease_id": id, "episode_id": named})).await;
    let state = socket.state().await;
    assert_eq!(
        (&state["episode_id"], &state["scenario_id"]),
        (&json!(named), &lease.0["groups"][1]["scenario"])
    );
    let _ = hold_to_the_end(&mut socket).await;
    for _ in 0..3 {
        let _ = socket.reset(json!({"run": "run", "lease_id": id})).await;
        let _ = hold_to_the_end(&mut socket).await;
    }
    assert_eq!(api.get(&format!("/v1/runs/run/leases/{id}")).await.expect(200)["status"], "done");
    let error = socket.request(&json!({"type": "reset", "data": {"run": "run", "lease_id": id}})).await;
    assert!(error["data"]["message"].as_str().unwrap().contains("lease"), "{error}");
}

#[tokio::test]
async fn dropped_connection_releases_its_lease() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api).await;
    let mut socket = OpenEnvSocket::connect(&api, "/ws").await;
    let _ = socket.reset(json!({"run": "run"})).await;
    let _ = socket.step(hold()).await;
    drop(socket);
    wait_until("the lease is released", async || {
        api.get("/v1/runs/run/leases").await.expect(200)["leases"][0]["status"] == "released"
    })
    .await;
    assert!(episodes(&api).await.is_empty());
}

#[tokio::test]
async fn concurrent_sessions_end_and_the_server_stops_gracefully() {
    let mut server = Server::start().await;
    let api = server.api();
    let clients = (0..32).map(|seed| {
        let api = api.clone();
        tokio::spawn(async move {
            let mut socket = OpenEnvSocket::connect(&api, "/ws").await;
            let first = socket.reset(json!({"seed": seed, "task": "survival"})).await;
            (first, hold_to_the_end(&mut socket).await)
        })
    });
    let mut first_observations = Vec::new();
    for client in clients.collect::<Vec<_>>() {
        let (first, last) = client.await.unwrap();
        assert_eq!(last["done"], true);
        first_observations.push(first.to_string());
    }
    first_observations.sort_unstable();
    first_observations.dedup();
    assert_eq!(first_observations.len(), 32);
    let mut open = OpenEnvSocket::connect(&api, "/ws").await;
    let _ = open.reset(json!({})).await;
    server.stop().await;
    assert!(
        matches!(open.receive().await, Received::Text(reply) if reply["data"]["code"] == "SESSION_ERROR")
    );
    assert_eq!(open.receive().await, Received::Closed(1000));
}

#[tokio::test]
async fn idle_session_is_closed() {
    let idle = Some(std::time::Duration::from_secs(1));
    let sessions =
        orchestrator::sessions::SessionLimits { max_sessions: 4, idle_timeout: idle, ..Default::default() };
    let server = Server::with_config(move |config| Config { sessions, ..config }).await;
    let mut socket = OpenEnvSocket::connect(&server.api(), "/ws").await;
    assert!(
        matches!(socket.receive().await, Received::Text(reply) if reply["data"]["code"] == "SESSION_TIMEOUT")
    );
    assert_eq!(socket.receive().await, Received::Closed(1000));
}

/// An oversized frame closes its connection, and no other one.
#[tokio::test]
async fn oversized_frame_ends_its_session() {
    let server = Server::start().await;
    let mut other = OpenEnvSocket::connect(&server.api(), "/ws").await;
    other.reset(json!({"seed": 1})).await;
    for path in ["/ws", "/mcp"] {
        let mut socket = OpenEnvSocket::connect(&server.api(), path).await;
        socket.send_text(format!("\"{}\"", " ".repeat(3 << 20))).await;
        assert!(matches!(socket.receive().await, Received::Text(_)), "{path}: frames of 3 MiB are read");
        // A client that is still sending may see a reset instead of the close code.
        let cut = !socket.try_send_text(&" ".repeat(5 << 20)).await;
        assert!(matches!(socket.receive().await, Received::Closed(code) if code == 1009 || cut), "{path}");
    }
    other.step(hold()).await;
}

#[tokio::test]
async fn tools_run_one_episode_and_cannot_reset() {
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
    let telemetry = tool("telemetry", json!({})).await;
    assert_eq!(telemetry["result"]["data"]["step"], 0);
    let conjunctions = tool("conjunctions", json!({})).await;
    assert!(conjunctions["result"]["data"]["conjunctions"].is_array(), "{conjunctions}");
    let burns = json!({"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0}]});
    let burn = tool("fire_thrusters", burns).await;
    let fuel =
        |reply: &Value| reply["result"]["data"]["observation"]["satellites"][0]["fuel"].as_f64().unwrap();
    assert!(fuel(&burn) < fuel(&telemetry), "{burn}");
    let wrong = tool("fire_thrusters", json!({"burns": [{"satellite_id": 0}]})).await;
    assert_eq!(wrong["error"]["code"], -32602);
    assert!(wrong["error"]["message"].as_str().unwrap().contains("burns.0.delta_vx"), "{wrong}");
    let last = tool("hold", json!({"steps": 60})).await;
    assert_eq!(last["result"]["data"]["done"], true);
    let error = tool("hold", json!({})).await;
    assert_eq!(error["error"]["code"], -32603, "{error}");
    let text = format!("{telemetry}{conjunctions}{burn}{last}");
    assert!(!text.contains("witness") && !text.contains("reference"), "tools do not expose the plan");
    assert_eq!(tool("reset", json!({})).await["error"]["code"], -32602);
}

/// On an MCP socket the session belongs to the connection: it is created on request, and again after its episode.
#[tokio::test]
async fn mcp_connection_runs_several_episodes() {
    let server = Server::start().await;
    let mut socket = OpenEnvSocket::connect(&server.api(), "/mcp").await;
    let mut call = async |method: &str, params: Value| {
        socket.request(&json!({"jsonrpc": "2.0", "id": 1, "method": method, "params": params})).await
    };
    for refused in [json!({"task": "nope"}), json!({"seed": -1}), json!({"run": "none"})] {
        let reply = call("openenv/session/create", refused.clone()).await;
        assert!(reply["error"]["code"].is_i64(), "{refused}: {reply}");
    }
    let created = call("openenv/session/create", json!({"task": "rendezvous", "seed": 2})).await;
    let session = created["result"]["session_id"].as_str().unwrap().to_owned();
    let request = json!({"session_id": session, "name": "telemetry", "arguments": {}});
    let telemetry = call("tools/call", request).await;
    assert!(telemetry.to_string().contains("RENDEZVOUS"), "{telemetry}");
    let another = call("openenv/session/create", json!({"task": "survival"})).await;
    assert_eq!(another["error"]["code"], -32602, "one flies: {another}");
    assert_eq!(call("openenv/session/create", json!({})).await["result"]["session_id"], session.as_str());
    let close = call("openenv/session/close", json!({"session_id": session})).await;
    assert_eq!(close["error"]["code"], -32602, "{close}");
    let hold = json!({"name": "hold", "arguments": {"steps": 60}});
    assert_eq!(call("tools/call", hold.clone()).await["result"]["data"]["done"], true);
    assert_eq!(call("tools/call", hold.clone()).await["error"]["code"], -32603);
    let recreated = call("openenv/session/create", json!({"task": "survival", "seed": 3})).await;
    assert_eq!(recreated["result"]["session_id"], session.as_str());
    assert_eq!(call("tools/call", hold).await["result"]["data"]["done"], true);
}

/// Two attached connections that called tools in each other's session waited for each other.
#[tokio::test]
async fn connection_uses_only_its_own_session() {
    let server = Server::start().await;
    let api = server.api();
    let create = json!({"jsonrpc": "2.0", "id": 1, "method": "openenv/session/create"});
    let mut ids = Vec::new();
    for _ in 0..2 {
        let created = api.post("/mcp", create.clone()).await.expect(200);
        ids.push(created["result"]["session_id"].as_str().unwrap().to_owned());
    }
    let call = |session: &str| {
        let params = json!({"name": "telemetry", "session_id": session});
        json!({"type": "mcp", "data": {"jsonrpc": "2.0", "id": 2, "method": "tools/call", "params": params}})
    };
    let mut socket = OpenEnvSocket::connect(&api, &format!("/ws?session_id={}", ids[0])).await;
    let own = socket.request(&call(&ids[0])).await;
    assert!(own["data"]["result"].is_object(), "{own}");
    let other = socket.request(&call(&ids[1])).await;
    let reason = other["data"]["error"]["message"].as_str().unwrap();
    assert!(reason.contains(&format!("the connection has the session {}", ids[0])), "{other}");
}
