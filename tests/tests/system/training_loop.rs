//! The training loop: propose, lease, roll out, report, replay and store. Mastery and level move, and the next proposal is
//! different.

use serde_json::{Value, json};
use system_tests::{PolicyRollout, Server, episode_result, log_to_json, run_policy};

async fn train_rounds(server: &Server, run: &str, policy: &str, leases: u32, groups: u32) -> Vec<Value> {
    let api = server.api();
    let mut moves = Vec::new();
    for _ in 0..leases {
        let lease = api.lease(run, json!({ "groups": groups })).await;
        let response = api.report(run, lease.results(policy)).await;
        moves.extend(response["moves"].as_array().unwrap().iter().cloned());
    }
    moves
}

#[tokio::test]
async fn heuristic_policy_is_promoted_and_scores_are_replayed() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "good", "seed": 7, "placement": false, "tasks": ["kessler/survival"], "contested_share": 1.0,
                      "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let params = |body: &Value| body["tasks"]["kessler/survival"].clone();
    let before = params(&api.get("/v1/runs/good/params").await.expect(200));

    let lease = api.lease("good", json!({"groups": 4})).await;
    let episodes = lease.episodes();
    for (group, (_, scenario)) in lease.0["groups"].as_array().unwrap().iter().zip(&episodes) {
        assert_eq!(group["scenario"], scenario.id().to_string());
        assert_eq!(group["contested"], true);
    }
    let results = episodes.iter().map(|(id, s)| episode_result(id, s, "heuristic")).collect();
    let response = api.report("good", results).await;
    for (receipt, (_, scenario)) in response["results"].as_array().unwrap().iter().zip(&episodes) {
        let outcome = run_policy(scenario, "heuristic").outcome;
        assert_eq!(receipt["score"].as_f64(), Some(outcome.score), "equal to the bit");
        assert_eq!(receipt["status"], "counted");
    }

    let moves = train_rounds(&server, "good", "heuristic", 5, 32).await;
    assert!(moves.iter().any(|m| m["kind"] == "up" && m["from"] == 0 && m["to"] == 1), "{moves:?}");
    let mastery = api.get("/v1/runs/good/mastery").await.expect(200);
    let task = &mastery["tasks"][0];
    assert!(task["level"].as_u64().unwrap() >= 1);
    assert_eq!(task["results"]["episodes"], 164);
    let levels = task["levels"].as_array().unwrap();
    assert!(levels.iter().any(|l| l["level"] == 0 && l["mean"].as_f64().unwrap() > 0.9), "{levels:?}");
    assert_ne!(params(&api.get("/v1/runs/good/params").await.expect(200)), before);

    let history = api.get("/v1/runs/good/level_moves").await.expect(200);
    let first = &history["moves"][0];
    let blocks = first["evidence"]["blocks"].as_array().unwrap();
    assert_eq!((blocks.len(), blocks[0]["n"].as_u64()), (2, Some(32)), "{first}");

    let points = history["points"].as_array().unwrap();
    let n: u64 = points.iter().map(|p| p["n"].as_u64().unwrap()).sum();
    assert_eq!(n, 164, "every contested scenario is counted once");

    let next = api.lease("good", json!({"groups": 1})).await;
    assert_ne!(
        next.0["recipes"][0]["params"], lease.0["recipes"][0]["params"],
        "the next proposal has other params"
    );
}

#[tokio::test]
async fn holding_policy_is_not_promoted() {
    let server = Server::start().await;
    let settings = json!({"strategy": "ladder", "id": "hold", "seed": 3, "placement": false, "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = server.api().post("/v1/runs", settings).await.expect(201);
    assert!(train_rounds(&server, "hold", "hold", 6, 64).await.is_empty());
    let task = server.api().get("/v1/runs/hold/mastery").await.expect(200)["tasks"][0].clone();
    assert_eq!(task["level"], 0);
    // Measured: holding succeeds on 95 % of all scenarios, and on a third of the contested ones.
    assert!(task["results"]["success"].as_f64().unwrap() > 0.5);
    assert!(task["mastery"]["mean"].as_f64().unwrap() < 0.6);
}

#[tokio::test]
async fn raw_rule_promotes_a_holding_policy() {
    let server = Server::start().await;
    let settings = json!({
        "strategy": "ladder", "id": "raw", "seed": 3, "placement": false, "tasks": ["kessler/survival"], "design": {"designer": "off"},
        "success": "raw", "task_settings": {"kessler/survival": {"success_threshold": 0.5}}
    });
    let _ = server.api().post("/v1/runs", settings).await.expect(201);
    let moves = train_rounds(&server, "raw", "hold", 5, 64).await;
    assert!(
        moves.iter().any(|m| m["kind"] == "up"),
        "the raw rule promotes a holding policy, which is why it is not the default"
    );
}

#[tokio::test]
async fn new_run_is_placed_by_bisection() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api
        .post(
            "/v1/runs",
            json!({"strategy": "ladder", "id": "p", "seed": 11, "tasks": ["kessler/survival"], "design": {"designer": "off"}}),
        )
        .await
        .expect(201);
    let moves = train_rounds(&server, "p", "heuristic", 10, 16).await;
    let placed = moves.iter().find(|m| m["kind"] == "placement").expect("a placement");
    // The heuristic policy succeeds on 0.96 of contested level 6, 0.85 of level 7 and 0.33 of level 8.
    assert!((6..=8).contains(&placed["to"].as_u64().unwrap()), "{placed}");
    assert!(placed["evidence"]["probes"].as_array().unwrap().len() >= 3);
}

#[tokio::test]
async fn baseline_strategies_serve_their_distribution() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "fixed", "strategy": "fixed"})).await.expect(201);
    let lease = api.lease("fixed", json!({"groups": 8})).await;
    let tasks: Vec<_> =
        lease.0["groups"].as_array().unwrap().iter().map(|g| g["task"].as_str().unwrap()).collect();
    assert_eq!(tasks[..4], tasks[4..], "tasks alternate");
    assert_eq!(lease.0["recipes"][0]["params"]["debris"], 25.0);
    let _ =
        api.post("/v1/runs", json!({"id": "uniform", "strategy": "uniform", "seed": 5})).await.expect(201);
    let lease = api.lease("uniform", json!({"groups": 64})).await;
    let levels: std::collections::BTreeSet<_> =
        lease.0["groups"].as_array().unwrap().iter().map(|g| g["level"].as_u64().unwrap()).collect();
    assert!(levels.len() >= 8, "{levels:?}");
}

/// A group has one scenario for all its episodes, as GRPO needs it.
#[tokio::test]
async fn group_of_eight_shares_one_scenario() {
    let server = Server::start().await;
    let api = server.api();
    let run =
        api.post("/v1/runs", json!({"strategy": "ladder", "id": "grpo", "group_size": 8})).await.expect(201);
    assert_eq!(
        run["settings"]["curriculum"]["target"], "half",
        "runs with groups target half success by default"
    );
    let lease = api.lease("grpo", json!({"groups": 8, "policy_version": 3})).await;
    let episodes = lease.episodes();
    assert_eq!(episodes.len(), 64);
    let names: std::collections::HashSet<_> = episodes.iter().map(|(id, _)| id.clone()).collect();
    assert_eq!(names.len(), 64);
    let mut scenarios = std::collections::HashSet::new();
    for (group, siblings) in lease.0["groups"].as_array().unwrap().iter().zip(episodes.chunks(8)) {
        assert!(siblings.iter().all(|(_, s)| s.id().to_string() == group["scenario"].as_str().unwrap()));
        scenarios.insert(group["scenario"].as_str().unwrap().to_owned());
    }
    assert_eq!(scenarios.len(), 8);
    // Episodes of a group differ. An unparsable action is the policy's fault: the episode is completed with holds.
    let results = episodes
        .iter()
        .enumerate()
        .map(|(i, (id, scenario))| match i % 8 {
            0 => json!({"episode": id, "actions": {"steps": [], "stopped": "unparsable"},
                        "metrics": {"temperature": 0.9, "tokens_in": 1200, "tokens_out": 300, "invalid_actions": 1}}),
            n if n < 4 => episode_result(id, scenario, "hold"),
            _ => episode_result(id, scenario, "heuristic"),
        })
        .collect();
    let response = api.report("grpo", results).await;
    assert!(response["results"].as_array().unwrap().iter().all(|r| r["status"] == "counted"), "{response}");
    let holding_receipt = &response["results"][0];
    assert_eq!(holding_receipt["score"], response["results"][1]["score"], "an empty log is a holding policy");
    let shown = api.get(&format!("/v1/runs/grpo/leases/{}", lease.id())).await.expect(200);
    assert_eq!(shown["status"], "done");
    assert!(shown["groups"].as_array().unwrap().iter().all(|g| g["state"] == "complete"));
    let episode = api.get(&format!("/v1/runs/grpo/episodes/{}", episodes[0].0)).await.expect(200);
    assert_eq!(episode["metrics"]["tokens_in"], 1200);
    assert_eq!(episode["actions"]["stopped"], "unparsable");
}

#[tokio::test]
async fn episode_can_be_read_and_replayed() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api
        .post(
            "/v1/runs",
            json!({"strategy": "ladder", "id": "r", "tasks": ["kessler/rendezvous"], "seed": 1, "design": {"designer": "off"}}),
        )
        .await
        .expect(201);
    let lease = api.lease("r", json!({"groups": 2})).await;
    let episodes = lease.episodes();
    let PolicyRollout { outcome, log } = run_policy(&episodes[0].1, "heuristic");
    let path = format!("/v1/runs/r/episodes/{}", episodes[0].0);
    assert_eq!(api.get(&path).await.expect(200)["state"], "leased");
    assert_eq!(api.get(&format!("{path}/replay")).await.status, 404, "the episode has no result yet");
    api.report("r", vec![json!({"episode": episodes[0].0, "actions": log_to_json(&log)})]).await;
    let shown = api.get(&path).await.expect(200);
    assert_eq!(shown["state"], "finished");
    assert_eq!(shown["outcome"]["total_reward"].as_f64(), Some(outcome.total_reward));
    assert_eq!(shown["scenario"], episodes[0].1.to_json());
    let replay = api.get(&format!("{path}/replay")).await.expect(200);
    let frames = replay["frames"].as_array().unwrap();
    assert_eq!(frames.len() as u32, outcome.steps + 1);
    let sum: f64 = frames.iter().map(|f| f["reward"].as_f64().unwrap()).sum();
    assert_eq!(sum, outcome.total_reward);
    assert_eq!(frames[0]["state"]["satellites"].as_array().unwrap().len(), 3);
    let list = api.get("/v1/runs/r/episodes").await.expect(200);
    assert_eq!(list["episodes"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn paused_run_accepts_results_but_no_leases() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"strategy": "ladder", "id": "p"})).await.expect(201);
    let lease = api.lease("p", json!({"groups": 1})).await;
    assert_eq!(api.post("/v1/runs/p/pause", json!({})).await.expect(200)["status"], "paused");
    assert_eq!(api.post("/v1/runs/p/leases", json!({"groups": 1})).await.status, 409);
    let (id, scenario) = &lease.episodes()[0];
    assert_eq!(
        api.report("p", vec![episode_result(id, scenario, "hold")]).await["results"][0]["status"],
        "counted"
    );
    assert_eq!(api.post("/v1/runs/p/resume", json!({})).await.expect(200)["status"], "active");
    api.lease("p", json!({"groups": 1})).await;
}
