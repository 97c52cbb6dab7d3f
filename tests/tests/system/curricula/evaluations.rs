//! Evaluations on frozen suites, with rollouts by the server and by a trainer in leases.

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, episode_result, wait_for};

use super::SURVIVAL;

/// Waits until an evaluation is complete; fails if it ends in any other state.
async fn wait_for_completion(api: &ApiClient, id: &str) -> Value {
    wait_for("the evaluation is complete", async || {
        let evaluation = api.get(&format!("/v1/evaluations/{id}")).await.expect(200);
        match evaluation["state"].as_str() {
            Some("complete") => Some(evaluation),
            Some("running" | "open") => None,
            _ => panic!("{evaluation}"),
        }
    })
    .await
}

async fn create_evaluation(api: &ApiClient, request: Value) -> String {
    api.post("/v1/evaluations", request).await.expect(201)["id"].as_str().unwrap().to_owned()
}

fn find_row<'a>(evaluation: &'a Value, task: &str, part: &str, policy: &str) -> &'a Value {
    let rows = evaluation["rows"].as_array().unwrap();
    rows.iter().find(|r| r["task"] == task && r["part"] == part && r["policy"] == policy).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn built_in_policies_are_evaluated_and_compared() {
    let mut server = Server::start().await;
    let api = server.api();
    let hold = create_evaluation(&api, json!({"policy": "hold"})).await;
    let heuristic = create_evaluation(&api, json!({"policy": "heuristic", "name": "by hand"})).await;
    // Episodes in progress at a restart are run again.
    server.restart().await;
    let api = server.api();
    let (held, flown) = (wait_for_completion(&api, &hold).await, wait_for_completion(&api, &heuristic).await);
    assert_eq!(
        (&held["scenarios"], &held["scenarios_done"], &held["rollouts"]),
        (&json!(768), &json!(768), &json!(1))
    );
    let success = |evaluation: &Value, policy: &str| {
        find_row(evaluation, "all", "contested", policy)["success"]["mean"].as_f64().unwrap()
    };
    assert!(
        success(&flown, "by hand") > success(&held, "hold") + 0.2,
        "{} {}",
        success(&flown, "by hand"),
        success(&held, "hold")
    );
    assert!(find_row(&held, SURVIVAL, "all", "hold")["cvar10"]["mean"].is_f64());

    let compared = compare(&api, &heuristic, &hold).await;
    let all = compared["rows"]
        .as_array()
        .unwrap()
        .iter()
        .find(|r| r["task"] == "all" && r["part"] == "contested")
        .unwrap();
    let gap = success(&flown, "by hand") - success(&held, "hold");
    assert!((all["success"]["mean"].as_f64().unwrap() - gap).abs() < 1e-9);
    assert!(
        all["success"]["low"].as_f64().unwrap() > 0.0 && all["improvement"]["mean"].as_f64().unwrap() > 0.6,
        "{all}"
    );
    assert_eq!(compared["a"]["across"]["trainings"], 1);

    let listed = api.get("/v1/evaluations?limit=1").await.expect(200);
    assert_eq!(listed["evaluations"][0]["id"], json!(heuristic));
    let next = listed["next"].as_str().unwrap();
    let rest = api.get(&format!("/v1/evaluations?limit=1&cursor={next}")).await.expect(200);
    assert_eq!(rest["evaluations"][0]["id"], json!(hold));
}

#[tokio::test(flavor = "multi_thread")]
async fn evaluation_of_one_task_uses_its_part_of_the_suite() {
    const SUITE: &str = "docking-heldout-v1";
    let server = Server::start().await;
    let api = server.api();
    let request = json!({"strategy": "ladder", "id": "run", "tasks": ["docking/single"], "placement": false, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", request).await.expect(201);
    let request = json!({"suite": SUITE, "policy": "mine", "run": "run", "rollouts": 1, "stochastic": false, "tasks": ["docking/single"]});
    let own_evaluation = create_evaluation(&api, request).await;
    let request = json!({"groups": 500, "purpose": "eval", "evaluation": own_evaluation});
    let all = api.lease("run", request).await;
    let episodes = all.episodes();
    assert_eq!(episodes.len(), 192, "half of the suite");
    assert!(episodes.iter().all(|(_, scenario)| scenario.task().id() == "docking/single"));
    for results in episodes.chunks(100) {
        let results =
            results.iter().map(|(id, scenario)| episode_result(id, scenario, "heuristic")).collect();
        let _ = api.report("run", results).await;
    }
    let evaluation = wait_for_completion(&api, &own_evaluation).await;
    assert_eq!((&evaluation["scenarios"], &evaluation["tasks"]), (&json!(192), &json!(["docking/single"])));
    let rows = evaluation["rows"].as_array().unwrap();
    assert!(rows.iter().all(|row| row["task"] != "docking/multiagent"), "{rows:?}");
    // The results equal those of the same part of an evaluation of the whole suite.
    let server_evaluation = create_evaluation(&api, json!({"suite": SUITE, "policy": "heuristic"})).await;
    let whole = wait_for_completion(&api, &server_evaluation).await;
    assert_eq!(whole["tasks"], Value::Null);
    for policy in ["mine", "blind_panel"] {
        let other = if policy == "mine" { "heuristic" } else { policy };
        let (a, b) = (
            find_row(&evaluation, "docking/single", "all", policy),
            find_row(&whole, "docking/single", "all", other),
        );
        assert_eq!((&a["score"], &a["success"]), (&b["score"], &b["success"]), "{policy}");
    }
    let compared = compare(&api, &own_evaluation, &server_evaluation).await;
    let rows = compared["rows"].as_array().unwrap();
    assert!(rows.iter().all(|row| row["task"] != "docking/multiagent" && row["score"]["mean"] == 0.0));
    let scenarios = api
        .get(&format!("/v1/evaluations/{own_evaluation}/scenarios?limit=500"))
        .await
        .expect(200)["scenarios"]
        .clone();
    assert_eq!(scenarios.as_array().unwrap().len(), 192);
    // The run has the episodes of its own evaluation; the server's evaluation has none.
    let first = scenarios[0]["first_episode"].as_str().unwrap();
    let episode = api.get(&format!("/v1/runs/run/episodes/{first}")).await.expect(200);
    assert_eq!(episode["scenario_id"], scenarios[0]["scenario_id"]);
    let server_scenarios =
        api.get(&format!("/v1/evaluations/{server_evaluation}/scenarios?limit=1")).await.expect(200);
    assert_eq!(server_scenarios["scenarios"][0]["first_episode"], Value::Null);
}

async fn compare(api: &ApiClient, a: &str, b: &str) -> Value {
    api.get(&format!("/v1/evaluations/compare?a={a}&b={b}")).await.expect(200)
}

async fn assert_duplicates_are_rejected(
    api: &ApiClient,
    own_evaluation: &str,
    server_evaluation: &str,
    hold: &str,
) {
    for (a, b) in [
        (format!("{own_evaluation},{own_evaluation}"), hold),
        (format!("{own_evaluation},{server_evaluation}"), server_evaluation),
        (format!("{own_evaluation},{hold}"), server_evaluation),
    ] {
        let rejected = api.get(&format!("/v1/evaluations/compare?a={a}&b={b}")).await.expect(422);
        assert!(rejected["detail"].as_str().unwrap().contains("eval-"), "{rejected}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn trainer_evaluates_its_policy_in_leases() {
    let server = Server::start().await;
    let api = server.api();
    let request = json!({"strategy": "ladder", "id": "run", "seed": 4, "tasks": [SURVIVAL], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", request).await.expect(201);
    let own_request = json!({"suite": "docking-heldout-v1", "policy": "mine", "run": "run", "rollouts": 1, "stochastic": false,
                      "training": "kind", "training_seed": 1});
    let own_evaluation = create_evaluation(&api, own_request).await;
    let request = json!({"groups": 100, "purpose": "eval", "evaluation": own_evaluation});
    // One lease is released: its scenarios are offered again.
    let given_up = api.lease("run", request.clone()).await;
    assert!(
        given_up.0["groups"].as_array().unwrap().iter().all(|g| g["role"] == "suite" && g["train"] == false)
    );
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", given_up.id()), json!({})).await.expect(200);
    // A result of another policy version is rejected.
    let other = api.lease("run", request.clone()).await;
    let (id, scenario) = other.episodes().swap_remove(0);
    let mut by_another = episode_result(&id, &scenario, "hold");
    by_another["policy_version"] = json!(7);
    let response = api.report("run", vec![by_another]).await;
    assert_eq!(response["results"][0]["code"], "version_mismatch", "{response}");
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", other.id()), json!({})).await.expect(200);
    let mut flown = 0;
    while flown < 384 {
        let lease = api.lease("run", request.clone()).await;
        let episodes = lease.episodes();
        flown += episodes.len();
        let results =
            episodes.iter().map(|(id, scenario)| episode_result(id, scenario, "heuristic")).collect();
        let response = api.report("run", results).await;
        assert!(
            response["results"].as_array().unwrap().iter().all(|r| r["status"] == "stored"),
            "evaluation results are stored only"
        );
    }
    let evaluation = wait_for_completion(&api, &own_evaluation).await;
    assert_eq!(flown, 384, "each scenario once");
    assert_eq!(evaluation["retries"], 200, "two leases of 100 groups were released");
    let nothing = api.post("/v1/runs/run/leases", request).await.expect(422);
    assert!(nothing["detail"].as_str().unwrap().contains("complete or leased"), "{nothing}");
    // The same policy evaluated by the server has the same results.
    let server_evaluation = create_evaluation(
        &api,
        json!({"suite": "docking-heldout-v1", "policy": "heuristic", "training": "kind", "training_seed": 2}),
    )
    .await;
    let other = wait_for_completion(&api, &server_evaluation).await;
    for task in ["docking/single", "docking/multiagent"] {
        let (a, b) = (find_row(&evaluation, task, "all", "mine"), find_row(&other, task, "all", "heuristic"));
        assert_eq!((&a["score"], &a["success"]), (&b["score"], &b["success"]), "{task}");
    }
    let compared = compare(&api, &own_evaluation, &server_evaluation).await;
    assert_eq!(compared["rows"][0]["score"]["mean"], 0.0);
    let hold = create_evaluation(&api, json!({"suite": "docking-heldout-v1", "policy": "hold"})).await;
    let _ = wait_for_completion(&api, &hold).await;
    let compared = compare(&api, &format!("{own_evaluation},{server_evaluation}"), &hold).await;
    assert_eq!(
        (&compared["a"]["across"]["trainings"], &compared["b"]["across"]["trainings"]),
        (&json!(2), &json!(1))
    );
    assert_eq!(compared["a"]["across"]["score"], json!(null), "two trainings are too few for an interval");
    assert_duplicates_are_rejected(&api, &own_evaluation, &server_evaluation, &hold).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn cancelled_evaluation_stores_results_but_stays_failed() {
    let server = Server::start().await;
    let api = server.api();
    let request = json!({"strategy": "ladder", "id": "run", "tasks": ["docking/single"], "placement": false, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", request).await.expect(201);
    let suite = json!({"suite": "docking-heldout-v1", "policy": "mine", "run": "run", "rollouts": 1,
                       "stochastic": false, "tasks": ["docking/single"]});
    let own_evaluation = create_evaluation(&api, suite).await;
    let request = json!({"groups": 500, "purpose": "eval", "evaluation": own_evaluation});
    let all = api.lease("run", request.clone()).await.episodes();
    let cancel = format!("/v1/evaluations/{own_evaluation}/cancel");
    for _ in 0..2 {
        let response = api.post(&cancel, json!({})).await.expect(200);
        assert_eq!((&response["state"], &response["error"]), (&json!("failed"), &json!("it was cancelled")));
    }
    let rejected = api.post("/v1/runs/run/leases", request).await.expect(422);
    assert!(rejected["detail"].as_str().unwrap().contains("cancelled"), "{rejected}");
    // Results of earlier leases are stored, but the evaluation stays cancelled.
    for results in all.chunks(100) {
        let results = results.iter().map(|(id, scenario)| episode_result(id, scenario, "hold")).collect();
        let response = api.report("run", results).await;
        assert!(
            response["results"].as_array().unwrap().iter().all(|one| one["status"] == "stored"),
            "{response}"
        );
    }
    let evaluation = api.get(&format!("/v1/evaluations/{own_evaluation}")).await.expect(200);
    assert_eq!((&evaluation["state"], &evaluation["scenarios_done"]), (&json!("failed"), &json!(192)));
    let server_evaluation =
        create_evaluation(&api, json!({"suite": "docking-heldout-v1", "policy": "hold"})).await;
    let _ = wait_for_completion(&api, &server_evaluation).await;
    let rejected =
        api.post(&format!("/v1/evaluations/{server_evaluation}/cancel"), json!({})).await.expect(409);
    assert_eq!(rejected["type"], "urn:sparring:problem:evaluation_ended");
    let unknown = api.post("/v1/evaluations/eval-99/cancel", json!({})).await.expect(404);
    assert_eq!(unknown["type"], "urn:sparring:problem:unknown_evaluation");
}

#[tokio::test(flavor = "multi_thread")]
async fn invalid_evaluations_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api
        .post("/v1/runs", json!({"strategy": "ladder", "id": "run", "tasks": [SURVIVAL]}))
        .await
        .expect(201);
    for (request, field) in [
        (json!({"policy": "golf"}), "policy"),
        (json!({"policy": "hold", "suite": "kessler-heldout-v9"}), "suite"),
        (json!({"policy": "hold", "suite": "../../etc/passwd"}), "suite"),
        (json!({"policy": "hold", "rollouts": 0}), "rollouts"),
        (json!({"policy": "hold", "policy_version": 3}), "policy_version"),
        (json!({"policy": "mine", "run": "NO"}), "run"),
        (json!({"policy": ""}), "policy"),
        (json!({"policy": "hold", "tasks": [SURVIVAL]}), "tasks"),
        (json!({"policy": "mine", "run": "run", "tasks": []}), "tasks"),
        (json!({"policy": "mine", "run": "run", "tasks": ["docking/single"]}), "tasks"),
    ] {
        let problem = api.post("/v1/evaluations", request.clone()).await.expect(422);
        assert!(
            problem["errors"].to_string().contains(field) || problem.to_string().contains(field),
            "{request}: {problem}"
        );
    }
    let _ = api.post("/v1/evaluations", json!({"policy": "mine", "run": "unknown"})).await.expect(404);
    let own_evaluation = create_evaluation(&api, json!({"policy": "mine", "run": "run"})).await;
    for (request, text) in [
        (json!({"groups": 1, "evaluation": own_evaluation}), "purpose: eval"),
        (json!({"groups": 1, "purpose": "eval", "evaluation": "eval-999"}), "eval-999 does not exist"),
        (json!({"groups": 1, "purpose": "eval", "evaluation": own_evaluation, "group_size": 3}), "must be 8"),
        (
            json!({"groups": 1, "purpose": "eval", "evaluation": own_evaluation, "policy_version": 5}),
            "must be 0",
        ),
        (
            json!({"groups": 1, "purpose": "eval", "evaluation": own_evaluation, "form": "columns"}),
            "must be groups",
        ),
    ] {
        let response = api.post("/v1/runs/run/leases", request.clone()).await;
        let status = response.status;
        let problem = response.expect(status);
        assert!(status == 422 && problem.to_string().contains(text), "{request}: {problem}");
    }
    let hold = create_evaluation(&api, json!({"policy": "hold", "suite": "docking-heldout-v1"})).await;
    for path in [
        format!("compare?a={own_evaluation}&b={own_evaluation}"),
        format!("compare?a={hold}&b=eval-77"),
        "eval-77".to_owned(),
        "compare?a=x&b=y".to_owned(),
    ] {
        let response = api.get(&format!("/v1/evaluations/{path}")).await;
        assert!([400, 404, 422].contains(&response.status), "{path}: {}", response.status);
    }
}
