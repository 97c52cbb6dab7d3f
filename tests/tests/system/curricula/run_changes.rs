//! Invalid settings, and changes of the settings of a run.

use serde_json::{Value, json};
use system_tests::{ApiClient, Server};

use super::{ECO, SURVIVAL, groups};

async fn train_once(api: &ApiClient, run: &str, policy: &str) -> Vec<Value> {
    let lease = api.lease(run, json!({"groups": 16})).await;
    let _ = api.report(run, lease.results(policy)).await;
    groups(&lease)
}

#[tokio::test(flavor = "multi_thread")]
async fn invalid_settings_are_rejected_by_field() {
    let server = Server::start().await;
    let api = server.api();
    let cases = [
        (json!({"strategy": "plrr"}), "strategy", "one of auto, staircase"),
        (
            json!({"strategy": "plr", "strategy_settings": {"replay": 2}}),
            "strategy_settings.replay",
            "from 0 to 1",
        ),
        (
            json!({"strategy": "plr", "strategy_settings": {"buffer": 3}}),
            "strategy_settings.buffer",
            "not a setting of the strategy plr",
        ),
        (json!({"strategy_settings": {"replay": 0.5}}), "strategy_settings.replay", "auto has no settings"),
        (
            json!({"strategy": "accel", "strategy_settings": {"score": "luck"}}),
            "strategy_settings.score",
            "one of learnability",
        ),
        (
            json!({"strategy": "alp_gmm", "strategy_settings": {"window": 2.5}}),
            "strategy_settings.window",
            "an integer",
        ),
        (
            json!({"tasks": [SURVIVAL], "task_settings": {SURVIVAL: {"levels": {"columns": ["debris", "fuel"], "rows": [[10, 5], [20]]}}}}),
            "task_settings.kessler/survival.levels",
            "",
        ),
    ];
    for (settings, field, detail) in cases {
        let problem = api.post("/v1/runs", settings.clone()).await;
        assert!([400, 422].contains(&problem.status), "{settings}: {}", problem.status);
        let status = problem.status;
        let problem = problem.expect(status);
        let text = problem.to_string();
        assert!(text.contains(field) && text.contains(detail), "{settings}: {text}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn changed_strategy_keeps_mastery_after_a_restart() {
    let mut server = Server::start().await;
    let api = server.api();
    let settings = json!({"id": "run", "seed": 4, "tasks": [SURVIVAL, ECO], "placement": false, "target": "mastery",
                      "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    for _ in 0..10 {
        let _ = train_once(&api, "run", "heuristic").await;
    }
    let before = api.get("/v1/runs/run/mastery").await.expect(200);
    let seen = |mastery: &Value| -> u64 {
        let tasks = mastery["tasks"].as_array().unwrap().iter();
        let levels = tasks.flat_map(|task| task["levels"].as_array().unwrap());
        levels.map(|level| level["seen"].as_u64().unwrap()).sum()
    };
    assert!(seen(&before) > 10, "{before}");

    // Slots of a lease from before the change keep their place in the mastery.
    let old = api.lease("run", json!({"groups": 24})).await;
    let changed = api
        .send_json("PATCH", "/v1/runs/run", json!({"strategy": "plr", "strategy_settings": {"filled": 6}}))
        .await;
    let changed = changed.expect(200);
    assert_eq!(changed["settings"]["curriculum"]["strategy"], "plr");
    assert_eq!(changed["settings"]["curriculum"]["strategy_settings"]["filled"], 6);
    assert_eq!(
        changed["settings"]["curriculum"]["strategy_settings"]["beta"], 0.3,
        "all settings are returned"
    );
    let _ = api.report("run", old.results("heuristic")).await;
    let after = api.get("/v1/runs/run/mastery").await.expect(200);
    assert!(seen(&after) > seen(&before), "mastery is kept, and old leases still count: {after}");
    assert_eq!(after["explanation"]["strategy"], "plr");

    let mut roles: Vec<String> = Vec::new();
    for _ in 0..6 {
        roles.extend(
            train_once(&api, "run", "hold")
                .await
                .iter()
                .map(|group| group["role"].as_str().unwrap().to_owned()),
        );
    }
    assert!(roles.iter().all(|role| role == "explore" || role == "replay"), "{roles:?}");
    assert!(roles.contains(&"replay".to_owned()));

    // A change of one setting keeps the others.
    let changed = api
        .send_json("PATCH", "/v1/runs/run", json!({"strategy_settings": {"beta": 0.5}, "name": "renamed"}))
        .await;
    let changed = changed.expect(200);
    assert_eq!(changed["settings"]["curriculum"]["strategy_settings"]["filled"], 6);
    assert_eq!(
        (&changed["name"], &changed["settings"]["curriculum"]["strategy_settings"]["beta"]),
        (&json!("renamed"), &json!(0.5))
    );
    server.restart().await;
    let api = server.api();
    let restarted = api.get("/v1/runs/run").await.expect(200);
    assert_eq!(restarted["settings"], changed["settings"]);
    assert_eq!(train_once(&api, "run", "hold").await.len(), 16);

    assert_invalid_changes_are_rejected(&api, &changed).await;
}

/// Checks that invalid changes are rejected and leave the settings as they are.
async fn assert_invalid_changes_are_rejected(api: &ApiClient, changed: &Value) {
    for (settings, field) in [
        (json!({"strategy_settings": {"beta": 0}}), "strategy_settings.beta"),
        (json!({"strategy": "ladder", "strategy_settings": {"beta": 0.5}}), "strategy_settings.beta"),
        (json!({"tasks": []}), "tasks"),
        (json!({"tasks": [SURVIVAL, "golf/driving"]}), "tasks.1"),
        (json!({"group_size": 0}), "group_size"),
        (json!({"seed": 5}), "seed"),
    ] {
        let problem = api.send_json("PATCH", "/v1/runs/run", settings.clone()).await;
        assert!([400, 422].contains(&problem.status), "{settings}: {}", problem.status);
        let status = problem.status;
        assert!(problem.expect(status).to_string().contains(field), "{settings}");
    }
    let unchanged = api.get("/v1/runs/run").await.expect(200);
    assert_eq!(unchanged["settings"], changed["settings"], "a rejected change has no effect");
}

#[tokio::test(flavor = "multi_thread")]
async fn added_task_keeps_the_level_of_the_others() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"id": "run", "strategy": "ladder", "seed": 4, "tasks": [SURVIVAL], "placement": false, "target": "mastery",
                      "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    for _ in 0..12 {
        let _ = train_once(&api, "run", "reference").await;
    }
    let level = |mastery: &Value| mastery["tasks"][0]["level"].as_u64().unwrap();
    let before = api.get("/v1/runs/run/mastery").await.expect(200);
    assert!(level(&before) > 0, "{before}");
    let _ = api.send_json("PATCH", "/v1/runs/run", json!({"tasks": [SURVIVAL, ECO]})).await.expect(200);
    let after = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!((after["tasks"].as_array().unwrap().len(), level(&after)), (2, level(&before)));
    let tasks: Vec<Value> =
        train_once(&api, "run", "hold").await.into_iter().map(|group| group["task"].clone()).collect();
    assert!(tasks.contains(&json!(ECO)), "{tasks:?}");
    // Another level table restarts the task at level 0.
    let levels = json!({"columns": ["debris", "fuel"], "rows": [[10, 50], [20, 20], [40, 10]]});
    let _ = api
        .send_json("PATCH", "/v1/runs/run", json!({"task_settings": {SURVIVAL: {"levels": levels}}}))
        .await
        .expect(200);
    let restarted = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(level(&restarted), 0);
}

/// A run that was changed before its first snapshot is restored from its first settings.
#[tokio::test(flavor = "multi_thread")]
async fn rejected_change_is_rolled_back_before_the_first_snapshot() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"id": "run", "seed": 4, "tasks": [SURVIVAL, ECO], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let _ = api.send_json("PATCH", "/v1/runs/run", json!({"strategy": "uniform"})).await.expect(200);
    // The rejected change is undone, and the run is restored from the store, which has no snapshot yet.
    let rejected = api.send_json("PATCH", "/v1/runs/run", json!({"contested_share": 7})).await;
    assert_eq!(rejected.status, 422);
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(mastery["explanation"]["strategy"], "uniform");
    assert_eq!(train_once(&api, "run", "hold").await.len(), 16);
}
