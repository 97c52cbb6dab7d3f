//! Settings that cannot be, and changing what a run is told.

use serde_json::{Value, json};
use system_tests::{Api, Server, result};

use super::{ECO, SURVIVAL, groups, lease};

async fn fly(api: &Api, run: &str, policy: &str) -> Vec<Value> {
    let lease = lease(api, run, json!({"groups": 16})).await;
    let results = lease.episodes().iter().map(|(id, scenario)| result(id, scenario, policy)).collect();
    let _ = api.report(run, results).await;
    groups(&lease)
}

#[tokio::test(flavor = "multi_thread")]
async fn settings_that_cannot_be_are_refused_with_their_field() {
    let server = Server::start().await;
    let api = server.api();
    let refused = [
        (json!({"strategy": "plrr"}), "strategy", "one of ladder, uniform"),
        (
            json!({"strategy": "plr", "strategy_settings": {"replay": 2}}),
            "strategy_settings.replay",
            "from 0 to 1",
        ),
        (
            json!({"strategy": "plr", "strategy_settings": {"buffer": 3}}),
            "strategy_settings.buffer",
            "no setting of plr",
        ),
        (json!({"strategy_settings": {"replay": 0.5}}), "strategy_settings.replay", "ladder has no settings"),
        (
            json!({"strategy": "accel", "strategy_settings": {"score": "luck"}}),
            "strategy_settings.score",
            "one of regret",
        ),
        (
            json!({"strategy": "alp_gmm", "strategy_settings": {"window": 2.5}}),
            "strategy_settings.window",
            "whole number",
        ),
        (
            json!({"tasks": [SURVIVAL], "task_settings": {SURVIVAL: {"levels": {"columns": ["debris", "fuel"], "rows": [[10, 5], [20]]}}}}),
            "task_settings.kessler/survival.levels",
            "",
        ),
    ];
    for (wish, field, words) in refused {
        let problem = api.post("/v1/runs", wish.clone()).await;
        assert!([400, 422].contains(&problem.status), "{wish}: {}", problem.status);
        let status = problem.status;
        let problem = problem.expect(status);
        let told = problem.to_string();
        assert!(told.contains(field) && told.contains(words), "{wish}: {told}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn another_strategy_keeps_what_was_mastered_and_survives_a_restart() {
    let mut server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "run", "seed": 4, "tasks": [SURVIVAL, ECO], "placement": false, "target": "mastery",
                      "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    for _ in 0..10 {
        let _ = fly(&api, "run", "heuristic").await;
    }
    let before = api.get("/v1/runs/run/mastery").await.expect(200);
    let seen = |mastery: &Value| mastery["tasks"][0]["levels"][0]["seen"].as_u64().unwrap();
    assert!(seen(&before) > 10, "{before}");

    // Leased before, reported after: it counts for mastery no more, and nothing breaks.
    let old = lease(&api, "run", json!({"groups": 4})).await;
    let changed = api
        .send("PATCH", "/v1/runs/run", json!({"strategy": "plr", "strategy_settings": {"filled": 6}}))
        .await;
    let changed = changed.expect(200);
    assert_eq!(changed["settings"]["curriculum"]["strategy"], "plr");
    assert_eq!(changed["settings"]["curriculum"]["strategy_settings"]["filled"], 6);
    assert_eq!(
        changed["settings"]["curriculum"]["strategy_settings"]["beta"], 0.3,
        "the others are told, too"
    );
    let results = old.episodes().iter().map(|(id, scenario)| result(id, scenario, "heuristic")).collect();
    let _ = api.report("run", results).await;
    let after = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(seen(&after), seen(&before), "mastery is kept, and old outcomes do not move it");
    assert_eq!(after["explanation"]["strategy"], "plr");

    let mut roles: Vec<String> = Vec::new();
    for _ in 0..6 {
        roles.extend(
            fly(&api, "run", "hold").await.iter().map(|group| group["role"].as_str().unwrap().to_owned()),
        );
    }
    assert!(roles.iter().all(|role| role == "explore" || role == "replay"), "{roles:?}");
    assert!(roles.contains(&"replay".to_owned()));

    // A setting alone; the others stay.
    let changed = api
        .send("PATCH", "/v1/runs/run", json!({"strategy_settings": {"beta": 0.5}, "name": "renamed"}))
        .await;
    let changed = changed.expect(200);
    assert_eq!(changed["settings"]["curriculum"]["strategy_settings"]["filled"], 6);
    assert_eq!(
        (&changed["name"], &changed["settings"]["curriculum"]["strategy_settings"]["beta"]),
        (&json!("renamed"), &json!(0.5))
    );
    server.restart().await;
    let api = server.api();
    let again = api.get("/v1/runs/run").await.expect(200);
    assert_eq!(again["settings"], changed["settings"]);
    assert_eq!(fly(&api, "run", "hold").await.len(), 16);
    refused(&api, &changed).await;
}

/// Changes that cannot be change nothing.
async fn refused(api: &Api, changed: &Value) {
    for (wish, field) in [
        (json!({"strategy_settings": {"beta": 0}}), "strategy_settings.beta"),
        (json!({"strategy": "ladder", "strategy_settings": {"beta": 0.5}}), "strategy_settings.beta"),
        (json!({"tasks": []}), "tasks"),
        (json!({"tasks": [SURVIVAL, "golf/driving"]}), "tasks.1"),
        (json!({"group_size": 0}), "group_size"),
        (json!({"seed": 5}), "seed"),
    ] {
        let problem = api.send("PATCH", "/v1/runs/run", wish.clone()).await;
        assert!([400, 422].contains(&problem.status), "{wish}: {}", problem.status);
        let status = problem.status;
        assert!(problem.expect(status).to_string().contains(field), "{wish}");
    }
    let unchanged = api.get("/v1/runs/run").await.expect(200);
    assert_eq!(unchanged["settings"], changed["settings"], "what is refused changes nothing");
}

#[tokio::test(flavor = "multi_thread")]
async fn tasks_come_and_go_and_the_others_keep_their_level() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "run", "seed": 4, "tasks": [SURVIVAL], "placement": false, "target": "mastery",
                      "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    for _ in 0..12 {
        let _ = fly(&api, "run", "reference").await;
    }
    let level = |mastery: &Value| mastery["tasks"][0]["level"].as_u64().unwrap();
    let before = api.get("/v1/runs/run/mastery").await.expect(200);
    assert!(level(&before) > 0, "{before}");
    let _ = api.send("PATCH", "/v1/runs/run", json!({"tasks": [SURVIVAL, ECO]})).await.expect(200);
    let after = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!((after["tasks"].as_array().unwrap().len(), level(&after)), (2, level(&before)));
    let tasks: Vec<Value> =
        fly(&api, "run", "hold").await.into_iter().map(|group| group["task"].clone()).collect();
    assert!(tasks.contains(&json!(ECO)), "{tasks:?}");
    // Another table is another course.
    let levels = json!({"columns": ["debris", "fuel"], "rows": [[10, 50], [20, 20], [40, 10]]});
    let _ = api
        .send("PATCH", "/v1/runs/run", json!({"task_settings": {SURVIVAL: {"levels": levels}}}))
        .await
        .expect(200);
    let afresh = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(level(&afresh), 0);
}

/// A run that was changed before it had a snapshot is folded from what it was told at first.
#[tokio::test(flavor = "multi_thread")]
async fn a_change_that_fails_after_one_that_did_not_leaves_the_run_whole() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "run", "seed": 4, "tasks": [SURVIVAL, ECO], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let _ = api.send("PATCH", "/v1/runs/run", json!({"strategy": "uniform"})).await.expect(200);
    // What is refused is undone, and the run restored from the store: it has no snapshot yet.
    let refused = api.send("PATCH", "/v1/runs/run", json!({"contested_share": 7})).await;
    assert_eq!(refused.status, 422);
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(mastery["explanation"]["strategy"], "uniform");
    assert_eq!(fly(&api, "run", "hold").await.len(), 16);
}
