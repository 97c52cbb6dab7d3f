//! Physics options of a run: from the wish that names them to the replay, the critique and the evaluation.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use sqlx::ConnectOptions;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{Api, Lease, Server, flown, result};

const SURVIVAL: &str = "kessler/survival";
const FORMATION: &str = "kessler/formation";

fn wish(id: &str, options: &Value) -> Value {
    json!({
        "id": id, "seed": 9, "placement": false, "tasks": [SURVIVAL, FORMATION],
        "task_settings": {SURVIVAL: {"physics": options}, FORMATION: {"physics": {"gravity": "j2"}}}
    })
}

/// Every recipe of a lease, as task → physics; a task has one.
fn physics(lease: &Lease) -> BTreeMap<String, Value> {
    let mut found = BTreeMap::new();
    for recipe in lease.0["recipes"].as_array().unwrap() {
        let task = recipe["task"].as_str().unwrap().to_owned();
        let told = found.entry(task).or_insert_with(|| recipe["physics"].clone());
        assert_eq!(*told, recipe["physics"], "one physics a task, at every level");
    }
    found
}

#[tokio::test]
async fn a_run_flies_by_its_options_from_lease_to_critique() {
    let server = Server::start().await;
    let api = server.api();
    let options = json!({"contact": "swept", "warnings": "exact", "risk": "contact"});
    let made = api.post("/v1/runs", wish("swept", &options)).await.expect(201);
    let shown = api.get("/v1/runs/swept").await.expect(200);
    assert_eq!(shown["settings"], made["settings"]);
    // What stands at its default says nothing.
    let plans = &shown["settings"]["curriculum"]["tasks"];
    assert_eq!(plans[0]["physics"], json!({"contact": "swept", "warnings": "exact"}));
    assert_eq!(plans[1]["physics"], json!({"gravity": "j2"}));

    let lease = api.lease("swept", json!({"groups": 16})).await;
    let told = physics(&lease);
    assert_eq!((&told[SURVIVAL]["contact"], &told[SURVIVAL]["gravity"]), (&json!("swept"), &json!("point")));
    assert_eq!(
        (&told[FORMATION]["contact"], &told[FORMATION]["gravity"]),
        (&json!("end_of_step"), &json!("j2"))
    );

    let episodes = lease.episodes();
    let results = episodes.iter().map(|(id, scenario)| result(id, scenario, "random")).collect();
    let answer = api.report("swept", results).await;
    for ((id, scenario), receipt) in episodes.iter().zip(answer["results"].as_array().unwrap()) {
        let (ours, log) = flown(scenario, "random");
        assert_eq!(receipt["score"].as_f64(), Some(ours.score), "to the bit, under its options");
        replays_as_flown(&api, id, scenario, ours.total).await;
        let critique = api.get(&format!("/v1/runs/swept/episodes/{id}/critique")).await.expect(200);
        let here = scenario.task().critique(scenario, &log).unwrap();
        assert_eq!(critique["failures"].as_array().unwrap().len(), here.failures.len(), "{critique}");
    }

    let eval = api.lease("swept", json!({"groups": 4, "purpose": "eval"})).await;
    assert_eq!(physics(&eval), told, "evaluations are flown by the run's physics");
}

/// The replay of an episode sums to what was flown; with telemetry it shows what the agents saw.
async fn replays_as_flown(api: &Api, id: &str, scenario: &env_core::Scenario, total: f64) {
    let path = format!("/v1/runs/swept/episodes/{id}/replay");
    let replay = api.get(&format!("{path}?telemetry=true")).await.expect(200);
    assert_eq!(replay["scenario"], scenario.to_json());
    let frames = replay["frames"].as_array().unwrap();
    let sum: f64 = frames.iter().map(|frame| frame["reward"].as_f64().unwrap()).sum();
    assert!((sum - total).abs() < 1e-12, "{sum} replayed, {total} flown: fifty additions");
    let warned = scenario.recipe().option("warnings") == Some("exact");
    assert!(frames.iter().all(|frame| frame["observation"]["conjunctions"].is_array() == warned));
    let plain = api.get(&path).await.expect(200);
    assert!(plain["frames"].as_array().unwrap().iter().all(|frame| frame.get("observation").is_none()));
}

/// Options change how a scenario is flown, and with it which are contested; the seeds a draw begins with are the same,
/// and so is everything in a run without any.
#[tokio::test]
async fn no_options_and_options_at_their_defaults_are_the_same_run() {
    let server = Server::start().await;
    let api = server.api();
    let bare = json!({"id": "bare", "seed": 9, "placement": false, "tasks": [SURVIVAL]});
    let defaults = json!({
        "id": "defaults", "seed": 9, "placement": false, "tasks": [SURVIVAL],
        "task_settings": {SURVIVAL: {"physics": {"contact": "end_of_step", "start": "fair"}}}
    });
    let swept = json!({
        "id": "swept", "seed": 9, "placement": false, "tasks": [SURVIVAL], "contested_share": 0.0,
        "task_settings": {SURVIVAL: {"physics": {"contact": "swept"}}}
    });
    let plain =
        json!({"id": "plain", "seed": 9, "placement": false, "tasks": [SURVIVAL], "contested_share": 0.0});
    let mut leases = Vec::new();
    for wish in [bare, defaults, swept, plain] {
        let id = wish["id"].as_str().unwrap().to_owned();
        let made = api.post("/v1/runs", wish).await.expect(201);
        let told = made["settings"]["curriculum"]["tasks"][0].get("physics").is_some();
        assert_eq!(told, id == "swept", "{made}");
        leases.push(api.lease(&id, json!({"groups": 12})).await);
    }
    let of = |lease: &Lease, what: &str| -> Vec<Value> {
        lease.0["groups"].as_array().unwrap().iter().map(|group| group[what].clone()).collect()
    };
    assert_eq!(of(&leases[0], "scenario"), of(&leases[1], "scenario"));
    assert_eq!(of(&leases[2], "seed"), of(&leases[3], "seed"));
    assert_ne!(of(&leases[2], "scenario"), of(&leases[3], "scenario"));
}

#[tokio::test]
async fn probability_of_collision_is_a_run_like_any_other() {
    let server = Server::start().await;
    let api = server.api();
    let options = json!({SURVIVAL: {"physics": {"risk": "pc"}}});
    let wish = json!({"id": "pc", "seed": 2, "placement": false, "tasks": [SURVIVAL], "contested_share": 1.0,
                      "task_settings": options});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let lease = api.lease("pc", json!({"groups": 8})).await;
    let groups = lease.0["groups"].as_array().unwrap();
    assert!(
        groups.iter().all(|group| group["contested"] == true),
        "levels have contested scenarios under it too"
    );
    let results = lease.episodes().iter().map(|(id, s)| result(id, s, "reference")).collect();
    let answer = api.report("pc", results).await;
    for receipt in answer["results"].as_array().unwrap() {
        assert_eq!((&receipt["status"], &receipt["success"]), (&json!("counted"), &json!(true)), "{receipt}");
    }
}

#[tokio::test]
async fn a_restart_keeps_options_and_proposals() {
    let mut server = Server::start().await;
    let options = json!({"contact": "swept"});
    let made = server.api().post("/v1/runs", wish("run", &options)).await.expect(201);
    let before = server.api().lease("run", json!({"groups": 4})).await;
    server.restart().await;
    let api = server.api();
    assert_eq!(api.get("/v1/runs/run").await.expect(200)["settings"], made["settings"]);
    let after = api.lease("run", json!({"groups": 80})).await;
    assert!(
        physics(&after).iter().all(|(task, told)| physics(&before).get(task).is_none_or(|was| was == told))
    );
    let other = Server::start().await;
    let _ = other.api().post("/v1/runs", wish("run", &options)).await.expect(201);
    let _ = other.api().lease("run", json!({"groups": 4})).await;
    let steady = other.api().lease("run", json!({"groups": 80})).await;
    assert_eq!(after.0["groups"].as_array().unwrap().len(), 80);
    let ids = |lease: &Lease| -> Vec<Value> {
        lease.0["groups"].as_array().unwrap().iter().map(|group| group["scenario"].clone()).collect()
    };
    assert_eq!(ids(&after), ids(&steady), "it proposes what it would have proposed");
}

/// Settings, proposals and snapshots stored before there were options have none: stored by this program they look the
/// same, so that what an older one wrote is read.
#[tokio::test]
async fn what_was_stored_without_options_has_none() {
    let mut server = Server::start().await;
    let _ =
        server.api().post("/v1/runs", json!({"id": "old", "seed": 4, "tasks": [SURVIVAL]})).await.expect(201);
    let before = server.api().lease("old", json!({"groups": 2})).await;
    server.stop().await;
    let options = SqliteConnectOptions::new().filename(server.db());
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
    assert_eq!(physics(&before), physics(&after));
}

#[tokio::test]
async fn options_that_are_none() {
    let server = Server::start().await;
    let api = server.api();
    let mut told = Vec::new();
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
        let wish =
            json!({"tasks": [SURVIVAL, "docking/single"], "task_settings": {task: {"physics": options}}});
        let answer = api.post("/v1/runs", wish).await;
        assert_eq!(answer.kind, "application/problem+json");
        let text = |what: &str| answer.body[what].as_str().unwrap_or_default().to_owned();
        told.push(format!("{} [{}]: {}", answer.status, text("field"), text("detail")));
    }
    insta::assert_snapshot!("refused", told.join("\n"));
    let runs = api.get("/v1/runs").await.expect(200);
    assert_eq!(runs["runs"], json!([]), "nothing came of it");
    // Nothing chosen is nothing chosen.
    let none = json!({"id": "none", "tasks": [SURVIVAL], "task_settings": {SURVIVAL: {"physics": null}}});
    let _ = api.post("/v1/runs", none).await.expect(201);
}

#[tokio::test]
async fn tasks_tell_their_options_in_full() {
    let server = Server::start().await;
    let tasks = server.api().get("/v1/tasks").await.expect(200);
    let of =
        |id: &str| tasks["tasks"].as_array().unwrap().iter().find(|task| task["id"] == id).unwrap().clone();
    insta::assert_json_snapshot!("kessler", of(SURVIVAL)["physics"]);
    assert_eq!(of("docking/single")["physics"], json!([]));
    // What is listed is what is taken, and what is said to be by hand is what is refused.
    for option in of(SURVIVAL)["physics"].as_array().unwrap() {
        for choice in option["choices"].as_array().unwrap() {
            let by_hand = option["by_hand"].as_array().unwrap().iter().any(|kept| kept["choice"] == *choice);
            let named = json!({option["name"].as_str().unwrap(): choice});
            let scenario = json!({"scenario": {"task": SURVIVAL, "seed": 1, "physics": named}});
            let _ = server.api().post("/v1/scenarios", scenario).await.expect(200);
            let run = json!({"tasks": [SURVIVAL], "task_settings": {SURVIVAL: {"physics": named}}});
            let made = server.api().post("/v1/runs", run).await;
            assert_eq!(made.status, if by_hand { 422 } else { 201 }, "{named}");
            if !by_hand {
                let id = made.body["id"].as_str().unwrap();
                let lease = server.api().lease(id, json!({"groups": 4})).await;
                let told = physics(&lease)[SURVIVAL].clone();
                assert_eq!(told[option["name"].as_str().unwrap()], *choice);
            }
        }
    }
}

#[tokio::test]
async fn a_scenario_by_hand_shows_what_its_agents_saw() {
    let server = Server::start().await;
    let api = server.api();
    let scenario = json!({"task": SURVIVAL, "seed": 7, "params": {"debris": 80, "radar_range": 30},
                          "physics": {"warnings": "noisy"}});
    let ask = async |extra: Value| {
        let mut body = json!({ "scenario": scenario });
        body.as_object_mut().unwrap().extend(extra.as_object().unwrap().clone());
        api.post("/v1/scenarios", body).await
    };
    assert!(ask(json!({})).await.expect(200).get("frames").is_none());
    let held = ask(json!({"telemetry": true})).await.expect(200);
    let same =
        ask(json!({"telemetry": true, "actions": {"steps": [], "stopped": "too_late"}})).await.expect(200);
    assert_eq!(held["frames"], same["frames"], "without actions nobody acts");
    assert!(held["flown"].is_null() && same["flown"].is_object());
    let frames = held["frames"].as_array().unwrap();
    let warnings: usize =
        frames.iter().map(|f| f["observation"]["conjunctions"].as_array().unwrap().len()).sum();
    assert!(warnings > 0);
    let seen = |frame: &Value, what: &str| frame[what]["radar_debris"].as_array().unwrap().len();
    assert!(frames.iter().any(|frame| seen(frame, "observation") < seen(frame, "state")), "some are hidden");

    let actions = json!({"steps": [[[0, 0.1, 0.0]]], "stopped": "too_long"});
    let flown = ask(json!({"telemetry": true, "actions": actions})).await.expect(200);
    assert_eq!(flown["frames"][1]["actions"], json!([[0, 0.1, 0.0]]));
    let total = flown["frames"].as_array().unwrap().last().unwrap()["observation"]["total_score"].clone();
    assert_eq!(total, flown["flown"]["total"]);

    let unfair = json!({"mode": "extend", "bodies": {"satellites": [[60, 0, 0, 4], [0, 60, -4, 0], [-60, 0, 0, -4]],
                                                     "debris": [[60, 0, 0, 4]]}});
    let mut body = json!({"scenario": {"task": SURVIVAL, "seed": 7, "layout": unfair}, "telemetry": true});
    let answer = api.post("/v1/scenarios", body.clone()).await.expect(200);
    assert!(answer["fair"] == false && answer.get("frames").is_none(), "{answer}");
    body["telemetry"] = json!("yes");
    assert_eq!(api.post("/v1/scenarios", body).await.expect(422)["field"], "telemetry");
}
