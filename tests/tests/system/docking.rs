//! The docking world through the same API: long episodes, one to five agents, three values an action.

use std::any::Any;

use env_core::ActionLog;
use env_core::policy::{Policy, PolicyError};
use env_core::rollout::{Rollout, roll_out};
use serde_json::{Value, json};
use system_tests::{PolicyRollout, Server, episode_result, log_to_json, run_policy};

const TASKS: [&str; 2] = ["docking/single", "docking/multiagent"];

#[tokio::test]
async fn heuristic_policy_is_promoted_in_docking() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "dock", "seed": 7, "placement": false, "tasks": TASKS, "contested_share": 1.0});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let mut moves: Vec<Value> = Vec::new();
    for _ in 0..5 {
        let lease = api.lease("dock", json!({"groups": 32})).await;
        for group in lease.0["groups"].as_array().unwrap() {
            assert_eq!(
                (&group["contested"], &group["bracket"]["panel_successes"]),
                (&json!(true), &json!(0))
            );
            assert!(group["bracket"]["panel_size"].as_u64().unwrap() >= 1);
        }
        let episodes = lease.episodes();
        let results =
            episodes.iter().map(|(id, scenario)| episode_result(id, scenario, "heuristic")).collect();
        let response = api.report("dock", results).await;
        for (receipt, (_, scenario)) in response["results"].as_array().unwrap().iter().zip(&episodes) {
            let expected = run_policy(scenario, "heuristic").outcome;
            assert_eq!(receipt["score"].as_f64(), Some(expected.score), "equal to the bit");
            assert_eq!(receipt["status"], "counted");
        }
        moves.extend(response["moves"].as_array().unwrap().iter().cloned());
    }
    for task in TASKS {
        assert!(moves.iter().any(|m| m["task"] == task && m["kind"] == "up"), "{task}: {moves:?}");
    }
    let mastery = api.get("/v1/runs/dock/mastery").await.expect(200);
    assert_eq!(mastery["tasks"].as_array().unwrap().len(), 2);

    // An evaluation lease at the reached levels, and one of its episodes.
    let lease = api.lease("dock", json!({"groups": 2, "purpose": "eval"})).await;
    let (name, scenario) = lease.episodes().swap_remove(1);
    let PolicyRollout { outcome, log } = run_policy(&scenario, "heuristic");
    api.report("dock", vec![json!({"episode": name, "actions": log_to_json(&log)})]).await;
    let shown = api.get(&format!("/v1/runs/dock/episodes/{name}")).await.expect(200);
    assert_eq!(shown["outcome"]["steps"], outcome.steps);
    assert_eq!(shown["actions"]["steps"], log_to_json(&log)["steps"], "the log is returned as it was sent");
    let replay = api.get(&format!("/v1/runs/dock/episodes/{name}/replay")).await.expect(200);
    assert_eq!(replay["frames"].as_array().unwrap().len(), outcome.steps as usize + 1);
}

#[tokio::test]
async fn holding_policy_never_docks() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api
        .post(
            "/v1/runs",
            json!({"strategy": "ladder", "id": "hold", "seed": 2, "placement": false, "tasks": TASKS}),
        )
        .await
        .expect(201);
    for _ in 0..3 {
        let lease = api.lease("hold", json!({"groups": 64})).await;
        let results = lease.results("hold");
        assert_eq!(api.report("hold", results).await["moves"], json!([]));
    }
    let mastery = api.get("/v1/runs/hold/mastery").await.expect(200);
    for task in mastery["tasks"].as_array().unwrap() {
        assert_eq!((&task["level"], &task["results"]["success"]), (&json!(0), &json!(0.0)), "{task}");
    }
}

/// Policy whose thrust is so weak that the episode lasts to the horizon; its numbers need many digits.
struct MinimalThrust;

impl Policy for MinimalThrust {
    fn act(&mut self, _: &dyn Any, log: &mut ActionLog) -> Result<(), PolicyError> {
        let sign = if log.len().is_multiple_of(2) { 1.0 } else { -1.0 };
        for agent in 0..5 {
            log.push_entry(agent, &[sign * 1.234_567_890_123_4e-5, sign / 3e5, -sign / 7e5]);
        }
        log.end_step();
        Ok(())
    }
}

/// The longest episodes with the most agents: one log is far below the limit of a request, a batch of forty exceeds it.
#[tokio::test]
async fn longest_logs_fit_and_oversized_batches_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    let table = json!({"columns": ["deputies", "start_radius", "speed_ratio"], "rows": [[5, 150, 0]]});
    let settings = json!({"strategy": "ladder", "id": "long", "tasks": ["docking/multiagent"], "group_size": 40, "placement": false,
        "task_settings": {"docking/multiagent": {"levels": table}}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let lease = api.lease("long", json!({"groups": 1})).await;
    let episodes = lease.episodes();
    let Rollout { outcome, log } = roll_out(&episodes[0].1, &mut MinimalThrust).unwrap();
    assert!(outcome.steps > 1900, "{outcome:?}");
    let actions = log_to_json(&log);
    let results: Vec<Value> =
        episodes.iter().map(|(episode, _)| json!({"episode": episode, "actions": actions})).collect();
    let bytes = results[0].to_string().len();
    assert!(bytes > 500_000 && bytes < 1_000_000, "{bytes}");
    let oversized = api.post("/v1/runs/long/results", json!({"results": results})).await;
    assert_eq!((oversized.status, oversized.body["title"].is_string()), (413, true), "{}", oversized.body);
    for batch in results.chunks(10) {
        for receipt in api.report("long", batch.to_vec()).await["results"].as_array().unwrap() {
            assert_eq!(
                (&receipt["status"], receipt["score"].as_f64()),
                (&json!("counted"), Some(outcome.score))
            );
        }
    }
}

#[tokio::test]
async fn invalid_docking_action_rejects_only_its_result() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api
        .post("/v1/runs", json!({"strategy": "ladder", "id": "bad", "tasks": ["docking/multiagent"]}))
        .await
        .expect(201);
    let lease = api.lease("bad", json!({"groups": 1})).await;
    let (name, _) = &lease.episodes()[0];
    for steps in
        [json!([[[0, 0.1, 0.0]]]), json!([[[99, 0.1, 0.0, 0.0]]]), json!([[["x", 0, 0, 0]]]), json!([7])]
    {
        let actions = json!({"steps": steps, "stopped": "too_late"});
        let report = api.report("bad", vec![json!({"episode": name, "actions": actions})]).await;
        assert_eq!(report["results"][0]["code"], "invalid_log", "{steps}: {report}");
    }
    let actions = json!({"steps": [[[0, 0.1, 0.0, -0.1]]], "stopped": "too_late"});
    let report = api.report("bad", vec![json!({"episode": name, "actions": actions})]).await;
    assert_eq!(report["results"][0]["status"], "counted", "{report}");
}

#[tokio::test]
async fn tasks_are_described_and_default_to_the_first_world() {
    let server = Server::start().await;
    let api = server.api();
    let tasks = api.get("/v1/tasks").await.expect(200)["tasks"].as_array().unwrap().clone();
    for task in &tasks {
        for field in ["policies", "reflex_params", "failure_modes"] {
            assert!(!task[field].as_array().unwrap().is_empty(), "{field} of {task}");
        }
        assert!(task["agents"].as_u64() >= Some(1) && task["horizon"].as_u64() >= Some(50), "{task}");
        assert!(task["speed_bands"]["unit"].is_string(), "{task}");
        let policies: Vec<&str> =
            task["policies"].as_array().unwrap().iter().filter_map(|p| p["name"].as_str()).collect();
        for name in ["hold", "random", "blind", "frozen", "heuristic", "reference"] {
            assert!(policies.contains(&name), "{name} of {task}");
        }
    }
    let docking = tasks.iter().find(|task| task["id"] == "docking/multiagent").unwrap();
    assert_eq!((&docking["agents"], &docking["horizon"]), (&json!(3), &json!(2000)));

    let _ = api.post("/v1/runs", json!({"strategy": "ladder", "id": "usual"})).await.expect(201);
    let mastery = api.get("/v1/runs/usual/mastery").await.expect(200);
    let listed = mastery["tasks"].as_array().unwrap().iter().filter_map(|task| task["task"].as_str());
    let usual: Vec<&str> = env_core::default_tasks().iter().map(|task| task.id()).collect();
    assert_eq!(listed.collect::<Vec<_>>(), usual);
    assert!(usual.iter().all(|task| task.starts_with("kessler/")), "{usual:?}");

    // A run may mix tasks of several worlds.
    let mixed = json!({"strategy": "ladder", "id": "mixed", "placement": false, "tasks": ["kessler/survival", "docking/single"]});
    let _ = api.post("/v1/runs", mixed).await.expect(201);
    let lease = api.lease("mixed", json!({"groups": 12})).await;
    let report = api.report("mixed", lease.results("heuristic")).await;
    assert!(
        report["results"].as_array().unwrap().iter().all(|receipt| receipt["status"] == "counted"),
        "{report}"
    );
}
