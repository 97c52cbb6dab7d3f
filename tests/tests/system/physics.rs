//! Physics options of a run, from the request that sets them to replay, critique and evaluation.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{ApiClient, Lease, PolicyRollout, Server, episode_result, run_policy};

const SURVIVAL: &str = "kessler/survival";
const FORMATION: &str = "kessler/formation";

fn run_settings(id: &str, options: &Value) -> Value {
    json!({
        "strategy": "ladder", "id": id, "seed": 9, "placement": false, "tasks": [SURVIVAL, FORMATION],
        "task_settings": {SURVIVAL: {"physics": options}, FORMATION: {"physics": {"gravity": "j2"}}}
    })
}

/// Returns the physics options of each task in a lease.
fn physics_by_task(lease: &Lease) -> BTreeMap<String, Value> {
    let mut found = BTreeMap::new();
    for recipe in lease.0["recipes"].as_array().unwrap() {
        let task = recipe["task"].as_str().unwrap().to_owned();
        let options = found.entry(task).or_insert_with(|| recipe["physics"].clone());
        assert_eq!(*options, recipe["physics"], "a task has the same options at every level");
    }
    found
}

#[tokio::test]
async fn run_options_apply_from_lease_to_critique() {
    let server = Server::start().await;
    let api = server.api();
    let options = json!({"contact": "swept", "warnings": "exact", "risk": "contact"});
    let created = api.post("/v1/runs", run_settings("swept", &options)).await.expect(201);
    let shown = api.get("/v1/runs/swept").await.expect(200);
    assert_eq!(shown["settings"], created["settings"]);
    // Options at their default are left out.
    let plans = &shown["settings"]["curriculum"]["tasks"];
    assert_eq!(plans[0]["physics"], json!({"contact": "swept", "warnings": "exact"}));
    assert_eq!(plans[1]["physics"], json!({"gravity": "j2"}));

    let lease = api.lease("swept", json!({"groups": 16})).await;
    let leased = physics_by_task(&lease);
    let survival = &leased[SURVIVAL];
    assert_eq!((&survival["contact"], &survival["gravity"]), (&json!("swept"), &json!("point")));
    assert_eq!(
        (&leased[FORMATION]["contact"], &leased[FORMATION]["gravity"]),
        (&json!("end_of_step"), &json!("j2"))
    );

    let episodes = lease.episodes();
    let results = episodes.iter().map(|(id, scenario)| episode_result(id, scenario, "random")).collect();
    let response = api.report("swept", results).await;
    for ((id, scenario), receipt) in episodes.iter().zip(response["results"].as_array().unwrap()) {
        let PolicyRollout { outcome, log } = run_policy(scenario, "random");
        assert_eq!(receipt["score"].as_f64(), Some(outcome.score), "equal to the bit");
        assert_replay_matches(&api, id, scenario, outcome.total_reward).await;
        let critique = api.get(&format!("/v1/runs/swept/episodes/{id}/critique")).await.expect(200);
        let expected = scenario.task().critique(scenario, &log).unwrap();
        assert_eq!(critique["failures"].as_array().unwrap().len(), expected.failures.len(), "{critique}");
    }

    let eval = api.lease("swept", json!({"groups": 4, "purpose": "eval"})).await;
    assert_eq!(physics_by_task(&eval), leased, "evaluations use the options of the run");
}

/// Checks that the rewards of a replay sum to `total`, and that telemetry adds the observations.
async fn assert_replay_matches(api: &ApiClient, id: &str, scenario: &env_core::Scenario, total: f64) {
    let path = format!("/v1/runs/swept/episodes/{id}/replay");
    let replay = api.get(&format!("{path}?telemetry=true")).await.expect(200);
    assert_eq!(replay["scenario"], scenario.to_json());
    let frames = replay["frames"].as_array().unwrap();
    let sum: f64 = frames.iter().map(|frame| frame["reward"].as_f64().unwrap()).sum();
    assert!((sum - total).abs() < 1e-12, "the replay sums to {sum}, the episode to {total}");
    let has_warnings = scenario.recipe().option("warnings") == Some("exact");
    assert!(frames.iter().all(|frame| frame["observation"]["conjunctions"].is_array() == has_warnings));
    let plain = api.get(&path).await.expect(200);
    assert!(plain["frames"].as_array().unwrap().iter().all(|frame| frame.get("observation").is_none()));
}

/// Explicit defaults give the same run as no options. Other options change the scenarios, but not the drawn seeds.
#[tokio::test]
async fn default_options_change_nothing() {
    let server = Server::start().await;
    let api = server.api();
    let without_options =
        json!({"strategy": "ladder", "id": "bare", "seed": 9, "placement": false, "tasks": [SURVIVAL]});
    let defaults = json!({
        "strategy": "ladder", "id": "defaults", "seed": 9, "placement": false, "tasks": [SURVIVAL],
        "task_settings": {SURVIVAL: {"physics": {"contact": "end_of_step", "start": "fair"}}}
    });
    let swept = json!({
        "strategy": "ladder", "id": "swept", "seed": 9, "placement": false, "tasks": [SURVIVAL], "contested_share": 0.0,
        "task_settings": {SURVIVAL: {"physics": {"contact": "swept"}}}
    });
    let plain = json!({"strategy": "ladder", "id": "plain", "seed": 9, "placement": false, "tasks": [SURVIVAL], "contested_share": 0.0});
    let mut leases = Vec::new();
    for settings in [without_options, defaults, swept, plain] {
        let id = settings["id"].as_str().unwrap().to_owned();
        let created = api.post("/v1/runs", settings).await.expect(201);
        let has_options = created["settings"]["curriculum"]["tasks"][0].get("physics").is_some();
        assert_eq!(has_options, id == "swept", "{created}");
        leases.push(api.lease(&id, json!({"groups": 12})).await);
    }
    let values = |lease: &Lease, field: &str| -> Vec<Value> {
        lease.0["groups"].as_array().unwrap().iter().map(|group| group[field].clone()).collect()
    };
    assert_eq!(values(&leases[0], "scenario"), values(&leases[1], "scenario"));
    assert_eq!(values(&leases[2], "seed"), values(&leases[3], "seed"));
    assert_ne!(values(&leases[2], "scenario"), values(&leases[3], "scenario"));
}

#[tokio::test]
async fn run_with_collision_probability_has_solvable_groups() {
    let server = Server::start().await;
    let api = server.api();
    let options = json!({SURVIVAL: {"physics": {"risk": "pc"}}});
    let settings = json!({"strategy": "ladder", "id": "pc", "seed": 2, "placement": false, "tasks": [SURVIVAL], "contested_share": 1.0,
                      "task_settings": options});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let lease = api.lease("pc", json!({"groups": 8})).await;
    let groups = lease.0["groups"].as_array().unwrap();
    assert!(groups.iter().all(|group| group["contested"] == true), "every leased group is contested");
    let response = api.report("pc", lease.results("reference")).await;
    for receipt in response["results"].as_array().unwrap() {
        assert_eq!((&receipt["status"], &receipt["success"]), (&json!("counted"), &json!(true)), "{receipt}");
    }
}

#[tokio::test]
async fn restart_keeps_options_and_proposals() {
    let mut server = Server::start().await;
    let options = json!({"contact": "swept"});
    let created = server.api().post("/v1/runs", run_settings("run", &options)).await.expect(201);
    let before = server.api().lease("run", json!({"groups": 4})).await;
    server.restart().await;
    let api = server.api();
    assert_eq!(api.get("/v1/runs/run").await.expect(200)["settings"], created["settings"]);
    let after = api.lease("run", json!({"groups": 80})).await;
    assert!(
        physics_by_task(&after)
            .iter()
            .all(|(task, options)| physics_by_task(&before).get(task).is_none_or(|before| before == options))
    );
    let other = Server::start().await;
    let _ = other.api().post("/v1/runs", run_settings("run", &options)).await.expect(201);
    let _ = other.api().lease("run", json!({"groups": 4})).await;
    let uninterrupted = other.api().lease("run", json!({"groups": 80})).await;
    assert_eq!(after.0["groups"].as_array().unwrap().len(), 80);
    let ids = |lease: &Lease| -> Vec<Value> {
        lease.0["groups"].as_array().unwrap().iter().map(|group| group["scenario"].clone()).collect()
    };
    assert_eq!(ids(&after), ids(&uninterrupted), "the restarted server proposes the same groups");
}

/// Settings, proposals and snapshots of a run without options do not mention them, and are readable after a restart.
#[tokio::test]
async fn default_options_are_not_stored() {
    let mut server = Server::start().await;
    let _ = server
        .api()
        .post("/v1/runs", json!({"strategy": "ladder", "id": "old", "seed": 4, "tasks": [SURVIVAL]}))
        .await
        .expect(201);
    let before = server.api().lease("old", json!({"groups": 2})).await;
    server.stop().await;
    let options = SqliteConnectOptions::new().filename(server.db_path());
    let mut conn = options.connect().await.unwrap();
    for sql in [
        "SELECT settings FROM runs",
        "SELECT body FROM curriculum_events",
        "SELECT body FROM curriculum_snapshots",
        "SELECT body FROM proposals",
    ] {
        let rows: Vec<String> = sqlx::query_scalar(sql).fetch_all(&mut conn).await.unwrap();
        assert!(rows.iter().all(|row| !row.contains("physics")), "{sql}: {rows:?}");
    }
    drop(conn);
    server.restart().await;
    let after = server.api().lease("old", json!({"groups": 2})).await;
    assert_eq!(physics_by_task(&before), physics_by_task(&after));
}

#[tokio::test]
async fn invalid_options_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    let mut problems = Vec::new();
    for (task, options) in [
        (SURVIVAL, json!({"drag": "on"})),
        (SURVIVAL, json!({"contact": "hard"})),
        (SURVIVAL, json!({"contact": true})),
        (SURVIVAL, json!({"contact": null})),
        (SURVIVAL, json!(["contact"])),
        (SURVIVAL, json!("swept")),
        (SURVIVAL, json!({"contact": "swept", "risk": "pc"})),
        (SURVIVAL, json!({"compat": "upstream"})),
        (SURVIVAL, json!({"compat": "upstream", "gravity": "j2"})),
        (SURVIVAL, json!({"a".repeat(500): "x"})),
        ("docking/single", json!({"contact": "swept"})),
        (FORMATION, json!({"contact": "swept"})),
    ] {
        let run_settings =
            json!({"tasks": [SURVIVAL, "docking/single"], "task_settings": {task: {"physics": options}}});
        let response = api.post("/v1/runs", run_settings).await;
        assert_eq!(response.content_type, "application/problem+json");
        let text = |field: &str| response.body[field].as_str().unwrap_or_default().to_owned();
        problems.push(format!("{} [{}]: {}", response.status, text("field"), text("detail")));
    }
    insta::assert_snapshot!("refused", problems.join("\n"));
    let runs = api.get("/v1/runs").await.expect(200);
    assert_eq!(runs["runs"], json!([]), "no run was created");
    // `null` stands for no options.
    let none = json!({"strategy": "ladder", "id": "none", "tasks": [SURVIVAL], "task_settings": {SURVIVAL: {"physics": null}}});
    let _ = api.post("/v1/runs", none).await.expect(201);
}

#[tokio::test]
async fn tasks_list_every_accepted_option() {
    let server = Server::start().await;
    let tasks = server.api().get("/v1/tasks").await.expect(200);
    let of =
        |id: &str| tasks["tasks"].as_array().unwrap().iter().find(|task| task["id"] == id).unwrap().clone();
    insta::assert_json_snapshot!("kessler", of(SURVIVAL)["physics"]);
    assert_eq!(of("docking/single")["physics"], json!([]));
    // Runs accept every listed choice, except those that are for single scenarios only.
    for option in of(SURVIVAL)["physics"].as_array().unwrap() {
        for choice in option["choices"].as_array().unwrap() {
            let by_hand =
                option["manual_choices"].as_array().unwrap().iter().any(|kept| kept["choice"] == *choice);
            let options = json!({option["name"].as_str().unwrap(): choice});
            let scenario = json!({"scenario": {"task": SURVIVAL, "seed": 1, "physics": options}});
            let _ = server.api().post("/v1/scenarios", scenario).await.expect(200);
            let run = json!({"tasks": [SURVIVAL], "task_settings": {SURVIVAL: {"physics": options}}});
            let created = server.api().post("/v1/runs", run).await;
            assert_eq!(created.status, if by_hand { 422 } else { 201 }, "{options}");
            if !by_hand {
                let id = created.body["id"].as_str().unwrap();
                let lease = server.api().lease(id, json!({"groups": 4})).await;
                let leased = physics_by_task(&lease)[SURVIVAL].clone();
                assert_eq!(leased[option["name"].as_str().unwrap()], *choice);
            }
        }
    }
}

#[tokio::test]
async fn scenario_endpoint_returns_telemetry() {
    let server = Server::start().await;
    let api = server.api();
    let scenario = json!({"task": SURVIVAL, "seed": 7, "params": {"debris": 80, "radar_range": 30},
                          "physics": {"warnings": "noisy"}});
    let request_scenario = async |fields: Value| {
        let mut body = json!({ "scenario": scenario });
        body.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        api.post("/v1/scenarios", body).await
    };
    assert!(request_scenario(json!({})).await.expect(200).get("frames").is_none());
    let held = request_scenario(json!({"telemetry": true})).await.expect(200);
    let same = request_scenario(json!({"telemetry": true, "actions": {"steps": [], "stopped": "too_late"}}))
        .await
        .expect(200);
    assert_eq!(held["frames"], same["frames"], "without actions the agents hold");
    assert!(held["outcome"].is_null() && same["outcome"].is_object());
    let frames = held["frames"].as_array().unwrap();
    let warnings: usize =
        frames.iter().map(|f| f["observation"]["conjunctions"].as_array().unwrap().len()).sum();
    assert!(warnings > 0);
    let debris = |frame: &Value, view: &str| frame[view]["radar_debris"].as_array().unwrap().len();
    let hides_debris = |frame: &Value| debris(frame, "observation") < debris(frame, "state");
    assert!(frames.iter().any(hides_debris), "radar range hides some debris");

    let actions = json!({"steps": [[[0, 0.1, 0.0]]], "stopped": "too_long"});
    let flown = request_scenario(json!({"telemetry": true, "actions": actions})).await.expect(200);
    assert_eq!(flown["frames"][1]["actions"], json!([[0, 0.1, 0.0]]));
    let total = flown["frames"].as_array().unwrap().last().unwrap()["observation"]["total_score"].clone();
    assert_eq!(total, flown["outcome"]["total_reward"]);

    let unfair = json!({"mode": "extend", "bodies": {"satellites": [[60, 0, 0, 4], [0, 60, -4, 0], [-60, 0, 0, -4]],
                                                     "debris": [[60, 0, 0, 4]]}});
    let mut body = json!({"scenario": {"task": SURVIVAL, "seed": 7, "layout": unfair}, "telemetry": true});
    let response = api.post("/v1/scenarios", body.clone()).await.expect(200);
    assert!(response["fair"] == false && response.get("frames").is_none(), "{response}");
    body["telemetry"] = json!("yes");
    assert_eq!(api.post("/v1/scenarios", body).await.expect(422)["field"], "telemetry");
}
