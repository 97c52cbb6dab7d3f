//! Evaluations on frozen suites: by the server, and by a trainer in leases.

use std::time::Duration;

use serde_json::{Value, json};
use system_tests::{Api, Server, result};

use super::{SURVIVAL, lease};

/// Waits until an evaluation is complete.
async fn complete(api: &Api, id: &str) -> Value {
    for _ in 0..600 {
        let found = api.get(&format!("/v1/evaluations/{id}")).await.expect(200);
        match found["state"].as_str() {
            Some("complete") => return found,
            Some("flying" | "open") => tokio::time::sleep(Duration::from_millis(100)).await,
            _ => panic!("{found}"),
        }
    }
    panic!("{id} is never complete");
}

async fn begin(api: &Api, wish: Value) -> String {
    api.post("/v1/evaluations", wish).await.expect(201)["id"].as_str().unwrap().to_owned()
}

fn row<'a>(found: &'a Value, task: &str, part: &str, policy: &str) -> &'a Value {
    let rows = found["rows"].as_array().unwrap();
    rows.iter().find(|r| r["task"] == task && r["part"] == part && r["policy"] == policy).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_server_flies_built_in_policies_and_compares_them() {
    let mut server = Server::start().await;
    let api = server.api();
    let hold = begin(&api, json!({"policy": "hold"})).await;
    let heuristic = begin(&api, json!({"policy": "heuristic", "name": "by hand"})).await;
    // What is under way when the server goes away is flown again.
    server.restart().await;
    let api = server.api();
    let (held, flown) = (complete(&api, &hold).await, complete(&api, &heuristic).await);
    assert_eq!(
        (&held["scenarios"], &held["flown"], &held["rollouts"]),
        (&json!(768), &json!(768), &json!(1))
    );
    let success = |found: &Value, policy: &str| {
        row(found, "all", "contested", policy)["success"]["mean"].as_f64().unwrap()
    };
    assert!(
        success(&flown, "by hand") > success(&held, "hold") + 0.2,
        "{} {}",
        success(&flown, "by hand"),
        success(&held, "hold")
    );
    assert!(row(&held, SURVIVAL, "all", "hold")["cvar10"]["mean"].is_f64());

    let compared = api.get(&format!("/v1/evaluations/compare?a={heuristic}&b={hold}")).await.expect(200);
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
async fn a_policy_of_one_task_flies_that_part_of_a_suite() {
    const SUITE: &str = "docking-heldout-v1";
    let server = Server::start().await;
    let api = server.api();
    let wish =
        json!({"id": "run", "tasks": ["docking/single"], "placement": false, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let wish = json!({"suite": SUITE, "policy": "mine", "run": "run", "rollouts": 1, "chance": false, "tasks": ["docking/single"]});
    let mine = begin(&api, wish).await;
    let wish = json!({"groups": 500, "purpose": "eval", "evaluation": mine});
    let all = lease(&api, "run", wish).await;
    let episodes = all.episodes();
    assert_eq!(episodes.len(), 192, "half of the suite");
    assert!(episodes.iter().all(|(_, scenario)| scenario.task().id() == "docking/single"));
    for results in episodes.chunks(100) {
        let results = results.iter().map(|(id, scenario)| result(id, scenario, "heuristic")).collect();
        let _ = api.report("run", results).await;
    }
    let found = complete(&api, &mine).await;
    assert_eq!((&found["scenarios"], &found["tasks"]), (&json!(192), &json!(["docking/single"])));
    let rows = found["rows"].as_array().unwrap();
    assert!(rows.iter().all(|row| row["task"] != "docking/multiagent"), "{rows:?}");
    // What is said of it is what is said of that part of a whole evaluation.
    let theirs = begin(&api, json!({"suite": SUITE, "policy": "heuristic"})).await;
    let whole = complete(&api, &theirs).await;
    assert_eq!(whole["tasks"], Value::Null);
    for policy in ["mine", "blind_panel"] {
        let other = if policy == "mine" { "heuristic" } else { policy };
        let (a, b) =
            (row(&found, "docking/single", "all", policy), row(&whole, "docking/single", "all", other));
        assert_eq!((&a["score"], &a["success"]), (&b["score"], &b["success"]), "{policy}");
    }
    let compared = api.get(&format!("/v1/evaluations/compare?a={mine}&b={theirs}")).await.expect(200);
    let rows = compared["rows"].as_array().unwrap();
    assert!(rows.iter().all(|row| row["task"] != "docking/multiagent" && row["score"]["mean"] == 0.0));
    let scenarios =
        api.get(&format!("/v1/evaluations/{mine}/scenarios?limit=500")).await.expect(200)["scenarios"]
            .clone();
    assert_eq!(scenarios.as_array().unwrap().len(), 192);
}

async fn refuses_what_counts_twice(api: &Api, mine: &str, theirs: &str, hold: &str) {
    for (a, b) in [
        (format!("{mine},{mine}"), hold),
        (format!("{mine},{theirs}"), theirs),
        (format!("{mine},{hold}"), theirs),
    ] {
        let refused = api.get(&format!("/v1/evaluations/compare?a={a}&b={b}")).await.expect(422);
        assert!(refused["detail"].as_str().unwrap().contains("eval-"), "{refused}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainer_flies_its_own_in_leases() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "run", "seed": 4, "tasks": [SURVIVAL], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let mine = json!({"suite": "docking-heldout-v1", "policy": "mine", "run": "run", "rollouts": 1, "chance": false,
                      "training": "kind", "training_seed": 1});
    let mine = begin(&api, mine).await;
    let wish = json!({"groups": 100, "purpose": "eval", "evaluation": mine});
    // One lease is given back: its scenarios are offered again.
    let given_up = lease(&api, "run", wish.clone()).await;
    assert!(
        given_up.0["groups"].as_array().unwrap().iter().all(|g| g["role"] == "suite" && g["train"] == false)
    );
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", given_up.id()), json!({})).await.expect(200);
    // What another version did is not told for this one's.
    let other = lease(&api, "run", wish.clone()).await;
    let (id, scenario) = other.episodes().swap_remove(0);
    let mut by_another = result(&id, &scenario, "hold");
    by_another["policy_version"] = json!(7);
    let told = api.report("run", vec![by_another]).await;
    assert_eq!(told["results"][0]["code"], "other_version", "{told}");
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", other.id()), json!({})).await.expect(200);
    let mut flown = 0;
    while flown < 384 {
        let lease = lease(&api, "run", wish.clone()).await;
        let episodes = lease.episodes();
        flown += episodes.len();
        let results = episodes.iter().map(|(id, scenario)| result(id, scenario, "heuristic")).collect();
        let told = api.report("run", results).await;
        assert!(
            told["results"].as_array().unwrap().iter().all(|r| r["status"] == "stored"),
            "an evaluation moves nothing"
        );
    }
    let found = complete(&api, &mine).await;
    assert_eq!(flown, 384, "each scenario once");
    assert_eq!(found["reflown"], 200, "of two leases nothing came");
    let nothing = api.post("/v1/runs/run/leases", wish).await.expect(422);
    assert!(nothing["detail"].as_str().unwrap().contains("flown"), "{nothing}");
    // The same policy flown by the server comes to the same.
    let theirs = begin(
        &api,
        json!({"suite": "docking-heldout-v1", "policy": "heuristic", "training": "kind", "training_seed": 2}),
    )
    .await;
    let other = complete(&api, &theirs).await;
    for task in ["docking/single", "docking/multiagent"] {
        let (a, b) = (row(&found, task, "all", "mine"), row(&other, task, "all", "heuristic"));
        assert_eq!((&a["score"], &a["success"]), (&b["score"], &b["success"]), "{task}");
    }
    let compared = api.get(&format!("/v1/evaluations/compare?a={mine}&b={theirs}")).await.expect(200);
    assert_eq!(compared["rows"][0]["score"]["mean"], 0.0);
    let hold = begin(&api, json!({"suite": "docking-heldout-v1", "policy": "hold"})).await;
    let _ = complete(&api, &hold).await;
    let compared = api.get(&format!("/v1/evaluations/compare?a={mine},{theirs}&b={hold}")).await.expect(200);
    assert_eq!(
        (&compared["a"]["across"]["trainings"], &compared["b"]["across"]["trainings"]),
        (&json!(2), &json!(1))
    );
    assert_eq!(compared["a"]["across"]["score"], json!(null), "of two nothing is said");
    refuses_what_counts_twice(&api, &mine, &theirs, &hold).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_nobody_will_fly_is_cancelled() {
    let server = Server::start().await;
    let api = server.api();
    let wish =
        json!({"id": "run", "tasks": ["docking/single"], "placement": false, "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let suite = json!({"suite": "docking-heldout-v1", "policy": "mine", "run": "run", "rollouts": 1,
                       "chance": false, "tasks": ["docking/single"]});
    let mine = begin(&api, suite).await;
    let wish = json!({"groups": 500, "purpose": "eval", "evaluation": mine});
    let all = lease(&api, "run", wish.clone()).await.episodes();
    let cancel = format!("/v1/evaluations/{mine}/cancel");
    for _ in 0..2 {
        let told = api.post(&cancel, json!({})).await.expect(200);
        assert_eq!((&told["state"], &told["trouble"]), (&json!("failed"), &json!("it was cancelled")));
    }
    let refused = api.post("/v1/runs/run/leases", wish).await.expect(422);
    assert!(refused["detail"].as_str().unwrap().contains("cancelled"), "{refused}");
    // What was leased before still comes in, and makes nothing of it that it is not.
    for results in all.chunks(100) {
        let results = results.iter().map(|(id, scenario)| result(id, scenario, "hold")).collect();
        let told = api.report("run", results).await;
        assert!(told["results"].as_array().unwrap().iter().all(|one| one["status"] == "stored"), "{told}");
    }
    let found = api.get(&format!("/v1/evaluations/{mine}")).await.expect(200);
    assert_eq!((&found["state"], &found["flown"]), (&json!("failed"), &json!(192)));
    let theirs = begin(&api, json!({"suite": "docking-heldout-v1", "policy": "hold"})).await;
    let _ = complete(&api, &theirs).await;
    let refused = api.post(&format!("/v1/evaluations/{theirs}/cancel"), json!({})).await.expect(409);
    assert_eq!(refused["type"], "urn:sparring:problem:evaluation_over");
    let unknown = api.post("/v1/evaluations/eval-99/cancel", json!({})).await.expect(404);
    assert_eq!(unknown["type"], "urn:sparring:problem:unknown_evaluation");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_evaluated_is_refused() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run", "tasks": [SURVIVAL]})).await.expect(201);
    for (wish, field) in [
        (json!({"policy": "golf"}), "policy"),
        (json!({"policy": "hold", "suite": "kessler-heldout-v9"}), "suite"),
        (json!({"policy": "hold", "suite": "../../etc/passwd"}), "suite"),
        (json!({"policy": "hold", "rollouts": 0}), "rollouts"),
        (json!({"policy": "hold", "version": 3}), "version"),
        (json!({"policy": "mine", "run": "NO"}), "run"),
        (json!({"policy": ""}), "policy"),
        (json!({"policy": "hold", "tasks": [SURVIVAL]}), "tasks"),
        (json!({"policy": "mine", "run": "run", "tasks": []}), "tasks"),
        (json!({"policy": "mine", "run": "run", "tasks": ["docking/single"]}), "tasks"),
    ] {
        let problem = api.post("/v1/evaluations", wish.clone()).await.expect(422);
        assert!(
            problem["errors"].to_string().contains(field) || problem.to_string().contains(field),
            "{wish}: {problem}"
        );
    }
    let _ = api.post("/v1/evaluations", json!({"policy": "mine", "run": "nobody"})).await.expect(404);
    let mine = begin(&api, json!({"policy": "mine", "run": "run"})).await;
    for (wish, words) in [
        (json!({"groups": 1, "evaluation": mine}), "purpose: eval"),
        (json!({"groups": 1, "purpose": "eval", "evaluation": "eval-999"}), "no evaluation"),
        (json!({"groups": 1, "purpose": "eval", "evaluation": mine, "group_size": 3}), "8 times"),
        (json!({"groups": 1, "purpose": "eval", "evaluation": mine, "policy_version": 5}), "of version 0"),
        (json!({"groups": 1, "purpose": "eval", "evaluation": mine, "form": "columns"}), "on groups"),
    ] {
        let answer = api.post("/v1/runs/run/leases", wish.clone()).await;
        let status = answer.status;
        let problem = answer.expect(status);
        assert!(status == 422 && problem.to_string().contains(words), "{wish}: {problem}");
    }
    let hold = begin(&api, json!({"policy": "hold", "suite": "docking-heldout-v1"})).await;
    for path in [
        format!("compare?a={mine}&b={mine}"),
        format!("compare?a={hold}&b=eval-77"),
        "eval-77".to_owned(),
        "compare?a=x&b=y".to_owned(),
    ] {
        let answer = api.get(&format!("/v1/evaluations/{path}")).await;
        assert!([400, 404, 422].contains(&answer.status), "{path}: {}", answer.status);
    }
}
