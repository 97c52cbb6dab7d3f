//! The tasking world through the same API: named actions, steps of different durations, and frames with the motion within steps.

use serde_json::{Value, json};
use system_tests::{Server, episode_result, run_policy};

use crate::openenv::socket::OpenEnvSocket;

const TASKS: [&str; 3] = ["tasking/scanning", "tasking/imaging", "tasking/constellation"];

/// Settings with short episodes: a level of each task.
fn short_episodes() -> Value {
    let table = |columns: Value, row: Value| json!({"levels": {"columns": columns, "rows": [row]}});
    let imaging = || table(json!(["targets", "time_limit_s"]), json!([1500, 5700]));
    json!({
        TASKS[0]: table(json!(["battery_wh", "time_limit_s"]), json!([400, 5700])),
        TASKS[1]: imaging(),
        TASKS[2]: imaging(),
    })
}

#[tokio::test]
async fn episodes_of_all_tasks_are_scored_by_replay() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "run", "seed": 3, "placement": false, "tasks": TASKS, "group_size": 1,
        "task_settings": short_episodes()});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let lease = api.lease("run", json!({"groups": 12})).await;
    let episodes = lease.episodes();
    let results = episodes.iter().map(|(id, scenario)| episode_result(id, scenario, "heuristic")).collect();
    let response = api.report("run", results).await;
    let mut tasks: Vec<&str> = Vec::new();
    for (receipt, (_, scenario)) in response["results"].as_array().unwrap().iter().zip(&episodes) {
        let expected = run_policy(scenario, "heuristic").outcome;
        assert_eq!(
            (receipt["score"].as_f64(), &receipt["status"]),
            (Some(expected.score), &json!("counted")),
            "{receipt}"
        );
        tasks.push(scenario.task().id());
    }
    assert!(TASKS.iter().all(|task| tasks.contains(task)), "{tasks:?}");

    let (name, scenario) = &episodes[0];
    let replay = api.get(&format!("/v1/runs/run/episodes/{name}/replay")).await.expect(200);
    let frames = replay["frames"].as_array().unwrap();
    assert!(frames[0]["state"]["map"]["objects"]["stations"].as_array().unwrap().len() > 3);
    assert!(frames[1]["state"]["map"]["objects"].is_null(), "objects are in the first frame only");
    let mut times = Vec::new();
    for frame in frames {
        let motion = &frame["state"]["map"]["motion"];
        times.extend(motion["time_s"].as_array().unwrap().iter().map(|time| time.as_f64().unwrap()));
        assert_eq!(
            motion["satellites"].as_array().unwrap().len(),
            scenario.task().agents(scenario.recipe()) as usize
        );
    }
    assert_eq!((times[0], *times.last().unwrap()), (0.0, 5700.0));
    assert!(times.windows(2).all(|pair| pair[0] < pair[1] && pair[1] - pair[0] <= 10.0), "{times:?}");
    let critique = api.get(&format!("/v1/runs/run/episodes/{name}/critique")).await.expect(200);
    assert!(critique["failures"].is_array());
}

#[tokio::test]
async fn invalid_actions_name_the_known_ones() {
    let server = Server::start().await;
    let api = server.api();
    let scenario = json!({"task": TASKS[0], "seed": 1, "params": {"time_limit_s": 1800}});
    for action in [json!(4), json!(-1), json!(0.5)] {
        let flight = json!({"scenario": scenario, "steps": [[[0, action]]]});
        let refused = api.post("/v1/rollouts", flight).await.expect(422);
        assert_eq!(refused["field"], "steps", "{refused}");
        assert!(refused["detail"].as_str().unwrap().contains("from 0 to 3"), "{refused}");
    }
    let step = json!({"actions": [{"satellite_id": 0, "action": "scan"}]});
    let reset = json!({"task": TASKS[0], "seed": 1, "params": {"time_limit_s": 1800}});
    let mut session = OpenEnvSocket::connect(&api, "/ws").await;
    let _ = session.request(&json!({"type": "reset", "data": reset})).await;
    let stepped = session.request(&json!({"type": "step", "data": step})).await;
    assert_eq!(stepped["data"]["observation"]["time_s"], 180.0, "{stepped}");
    let wrong = json!({"actions": [{"satellite_id": 0, "action": "image_0"}]});
    let refused = session.request(&json!({"type": "step", "data": wrong})).await;
    assert!(refused.to_string().contains("'scan', 'charge', 'downlink' or 'desaturate'"), "{refused}");
}

#[tokio::test]
async fn tools_act_with_one_satellite_or_several() {
    let server = Server::start().await;
    let api = server.api();
    let call = async |method: &str, params: Value| -> Value {
        let request = json!({"jsonrpc": "2.0", "id": 1, "method": method, "params": params});
        api.post("/mcp", request).await.expect(200)
    };
    let params = json!({"targets": 300, "time_limit_s": 3000});
    let created =
        call("openenv/session/create", json!({"task": TASKS[2], "seed": 5, "params": params})).await;
    let session = created["result"]["session_id"].as_str().unwrap().to_owned();
    let listed = call("tools/list", json!({"session_id": session})).await;
    let tools = listed["result"]["tools"].as_array().unwrap();
    let names: Vec<&str> = tools.iter().map(|tool| tool["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["image", "charge", "downlink", "desaturate", "act", "hold", "telemetry"]);
    let tool = async |name: &str, arguments: Value| {
        call("tools/call", json!({"session_id": session, "name": name, "arguments": arguments})).await
    };
    let all = json!({"actions": [{"satellite_id": 0, "action": "image_0"}, {"satellite_id": 1, "action": "charge"},
                                 {"satellite_id": 2, "action": "downlink"}]});
    let acted = tool("act", all).await;
    let satellites = &acted["result"]["data"]["observation"]["satellites"];
    assert_eq!([0, 1, 2].map(|id| satellites[id]["action"].clone()), ["image_0", "charge", "downlink"]);
    let charged = tool("charge", json!({"satellite_id": 2})).await;
    assert!(charged["result"]["data"]["observation"]["time_s"].as_f64() > Some(60.0), "{charged}");
    for (name, arguments, fault) in [
        ("image", json!({}), "index: is required"),
        ("image", json!({"index": 10}), "index: must be an integer from 0 to 9, got 10"),
        ("charge", json!({"satellite_id": 3}), "agent 3 does not exist: the episode has the agents 0 to 2"),
        ("charge", json!({"satellite": 1}), "satellite: the tool has no such argument"),
        ("scan", json!({}), r#"tool "scan" does not exist"#),
        ("fire_thrusters", json!({}), r#"tool "fire_thrusters" does not exist"#),
    ] {
        let refused = tool(name, arguments).await;
        assert!(refused["error"]["message"].as_str().unwrap().contains(fault), "{refused}");
    }
}
