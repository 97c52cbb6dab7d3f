//! Another world than the first through the same doors: long episodes, one to five agents, three values an action.

use std::any::Any;

use env_core::ActionLog;
use env_core::policy::Policy;
use env_core::rollout::fly;
use serde_json::{Value, json};
use system_tests::{Server, flown, result, wire};

const TASKS: [&str; 2] = ["docking/single", "docking/multiagent"];

#[tokio::test]
async fn docking_is_leased_flown_and_replayed_and_a_good_pilot_climbs() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "dock", "seed": 7, "placement": false, "tasks": TASKS, "contested_share": 1.0});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let mut moves: Vec<Value> = Vec::new();
    for _ in 0..5 {
        let lease = api.lease("dock", json!({"groups": 32})).await;
        for group in lease.0["groups"].as_array().unwrap() {
            assert_eq!((&group["contested"], &group["bracket"]["panel_success"]), (&json!(true), &json!(0)));
            assert!(group["bracket"]["panel"].as_u64().unwrap() >= 1);
        }
        let episodes = lease.episodes();
        let results = episodes.iter().map(|(id, scenario)| result(id, scenario, "heuristic")).collect();
        let answer = api.report("dock", results).await;
        for (receipt, (_, scenario)) in answer["results"].as_array().unwrap().iter().zip(&episodes) {
            let ours = flown(scenario, "heuristic").0;
            assert_eq!(receipt["score"].as_f64(), Some(ours.score), "to the bit");
            assert_eq!(receipt["status"], "counted");
        }
        moves.extend(answer["moves"].as_array().unwrap().iter().cloned());
    }
    for task in TASKS {
        assert!(moves.iter().any(|m| m["task"] == task && m["kind"] == "up"), "{task}: {moves:?}");
    }
    let mastery = api.get("/v1/runs/dock/mastery").await.expect(200);
    assert_eq!(mastery["tasks"].as_array().unwrap().len(), 2);

    // An evaluation at the levels reached, and an episode looked at.
    let lease = api.lease("dock", json!({"groups": 2, "purpose": "eval"})).await;
    let (name, scenario) = lease.episodes().swap_remove(1);
    let (ours, log) = flown(&scenario, "heuristic");
    api.report("dock", vec![json!({"episode": name, "actions": wire(&log)})]).await;
    let shown = api.get(&format!("/v1/runs/dock/episodes/{name}")).await.expect(200);
    assert_eq!(shown["flown"]["steps"], ours.steps);
    assert_eq!(shown["actions"]["steps"], wire(&log)["steps"], "the log comes back as it was sent");
    let replay = api.get(&format!("/v1/runs/dock/episodes/{name}/replay")).await.expect(200);
    assert_eq!(replay["frames"].as_array().unwrap().len(), ours.steps as usize + 1);
}

#[tokio::test]
async fn doing_nothing_for_two_thousand_steps_docks_nobody() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api
        .post("/v1/runs", json!({"id": "hold", "seed": 2, "placement": false, "tasks": TASKS}))
        .await
        .expect(201);
    for _ in 0..3 {
        let lease = api.lease("hold", json!({"groups": 64})).await;
        let results = lease.episodes().iter().map(|(id, scenario)| result(id, scenario, "hold")).collect();
        assert_eq!(api.report("hold", results).await["moves"], json!([]));
    }
    let mastery = api.get("/v1/runs/hold/mastery").await.expect(200);
    for task in mastery["tasks"].as_array().unwrap() {
        assert_eq!((&task["level"], &task["plain"]["success"]), (&json!(0), &json!(0.0)), "{task}");
    }
}

/// Thrust so weak that nobody gets anywhere before the horizon, in numbers that take many digits.
struct Dither;

impl Policy for Dither {
    fn act(&mut self, _: &dyn Any, log: &mut ActionLog) {
        let sign = if log.len().is_multiple_of(2) { 1.0 } else { -1.0 };
        (0..5).for_each(|agent| log.act(agent, &[sign * 1.234_567_890_123_4e-5, sign / 3e5, -sign / 7e5]));
        log.end_step();
    }
}

/// The longest episodes there are, by the most agents there are: each is far below what a request may have, and a batch
/// of forty of them is refused in words.
#[tokio::test]
async fn the_longest_logs_go_through_and_too_many_of_them_do_not() {
    let server = Server::start().await;
    let api = server.api();
    let table = json!({"columns": ["deputies", "start_radius", "speed_ratio"], "rows": [[5, 150, 0]]});
    let wish = json!({"id": "long", "tasks": ["docking/multiagent"], "group_size": 40, "placement": false,
        "task_settings": {"docking/multiagent": {"levels": table}}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let lease = api.lease("long", json!({"groups": 1})).await;
    let episodes = lease.episodes();
    let (flown, log) = fly(&episodes[0].1, &mut Dither).unwrap();
    assert!(flown.steps > 1900, "{flown:?}");
    let actions = wire(&log);
    let results: Vec<Value> =
        episodes.iter().map(|(episode, _)| json!({"episode": episode, "actions": actions})).collect();
    let bytes = results[0].to_string().len();
    assert!(bytes > 500_000 && bytes < 1_000_000, "{bytes}");
    let too_much = api.post("/v1/runs/long/results", json!({"results": results})).await;
    assert_eq!((too_much.status, too_much.body["title"].is_string()), (413, true), "{}", too_much.body);
    for batch in results.chunks(10) {
        for receipt in api.report("long", batch.to_vec()).await["results"].as_array().unwrap() {
            assert_eq!(
                (&receipt["status"], receipt["score"].as_f64()),
                (&json!("counted"), Some(flown.score))
            );
        }
    }
}

#[tokio::test]
async fn what_is_no_action_of_docking_is_refused_by_itself() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "bad", "tasks": ["docking/multiagent"]})).await.expect(201);
    let lease = api.lease("bad", json!({"groups": 1})).await;
    let (name, _) = &lease.episodes()[0];
    for steps in
        [json!([[[0, 0.1, 0.0]]]), json!([[[99, 0.1, 0.0, 0.0]]]), json!([[["x", 0, 0, 0]]]), json!([7])]
    {
        let actions = json!({"steps": steps, "stopped": "too_late"});
        let told = api.report("bad", vec![json!({"episode": name, "actions": actions})]).await;
        assert_eq!(told["results"][0]["code"], "invalid_log", "{steps}: {told}");
    }
    let actions = json!({"steps": [[[0, 0.1, 0.0, -0.1]]], "stopped": "too_late"});
    let told = api.report("bad", vec![json!({"episode": name, "actions": actions})]).await;
    assert_eq!(told["results"][0]["status"], "counted", "{told}");
}

#[tokio::test]
async fn tasks_are_told_as_data_and_runs_are_of_the_first_world_unless_told() {
    let server = Server::start().await;
    let api = server.api();
    let tasks = api.get("/v1/tasks").await.expect(200)["tasks"].as_array().unwrap().clone();
    for task in &tasks {
        for field in ["policies", "reflex", "failure_modes"] {
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

    let _ = api.post("/v1/runs", json!({"id": "usual"})).await.expect(201);
    let mastery = api.get("/v1/runs/usual/mastery").await.expect(200);
    let told = mastery["tasks"].as_array().unwrap().iter().filter_map(|task| task["task"].as_str());
    let usual: Vec<&str> = env_core::usual_tasks().iter().map(|task| task.id()).collect();
    assert_eq!(told.collect::<Vec<_>>(), usual);
    assert!(usual.iter().all(|task| task.starts_with("kessler/")), "{usual:?}");

    // An agent that can act in several worlds may train in all of them at once.
    let mixed = json!({"id": "mixed", "placement": false, "tasks": ["kessler/survival", "docking/single"]});
    let _ = api.post("/v1/runs", mixed).await.expect(201);
    let lease = api.lease("mixed", json!({"groups": 12})).await;
    let results = lease.episodes().iter().map(|(id, scenario)| result(id, scenario, "heuristic")).collect();
    let told = api.report("mixed", results).await;
    assert!(
        told["results"].as_array().unwrap().iter().all(|receipt| receipt["status"] == "counted"),
        "{told}"
    );
}
