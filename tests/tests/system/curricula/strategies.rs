//! Groups that strategies propose: replays, edits with their lineage, and groups that are not for training.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, episode_result, wait_until};

use super::{ECO, SURVIVAL, groups};

/// Leases 16 groups `leases` times and reports their results; returns each group with its recipe.
async fn train(api: &ApiClient, run: &str, leases: usize) -> Vec<(Value, Value)> {
    let mut all = Vec::new();
    for number in 0..leases {
        let lease = api.lease(run, json!({"groups": 16})).await;
        let policy = if number % 2 == 0 { "hold" } else { "heuristic" };
        let report = api.report(run, lease.results(policy)).await;
        let counted = report["results"].as_array().unwrap().iter().all(|one| one["status"] == "counted");
        assert!(counted, "{report}");
        for group in groups(&lease) {
            let recipe = lease.0["recipes"][group["recipe"].as_u64().unwrap() as usize].clone();
            all.push((group, recipe));
        }
    }
    all
}

async fn create(api: &ApiClient, strategy: &str, settings: Value) {
    let settings = json!({"id": strategy, "seed": 5, "strategy": strategy, "strategy_settings": settings, "group_size": 2,
                      "tasks": [SURVIVAL, ECO], "design": {"designer": "off"}});
    let run = api.post("/v1/runs", settings).await.expect(201);
    assert_eq!(run["settings"]["curriculum"]["strategy"], strategy);
}

fn with_role<'a>(leased: &'a [(Value, Value)], role: &str) -> Vec<&'a (Value, Value)> {
    leased.iter().filter(|(group, _)| group["role"] == role).collect()
}

fn text(value: &Value) -> String {
    value.as_str().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn every_strategy_proposes_the_same_after_a_restart() {
    let listed = Server::start().await.api().get("/v1/strategies").await.expect(200);
    let names: Vec<String> =
        listed["strategies"].as_array().unwrap().iter().map(|s| text(&s["name"])).collect();
    assert_eq!(names.len(), 13, "{names:?}");
    let (mut server, uninterrupted) = (Server::start().await, Server::start().await);
    for name in &names {
        for api in [server.api(), uninterrupted.api()] {
            create(&api, name, json!({})).await;
            let _ = train(&api, name, 4).await;
        }
    }
    server.restart().await;
    for name in names {
        let after = [train(&server.api(), &name, 2).await, train(&uninterrupted.api(), &name, 2).await];
        let proposed = after
            .map(|leased| leased.into_iter().map(|(group, _)| group["scenario"].clone()).collect::<Vec<_>>());
        assert_eq!(proposed[0], proposed[1], "{name}: a restart does not change the proposals");
        let mastery = server.api().get(&format!("/v1/runs/{name}/mastery")).await.expect(200);
        assert_eq!(mastery["explanation"]["strategy"], *name);
        assert!(!mastery["explanation"]["rules"].as_array().unwrap().is_empty(), "{mastery}");
        assert_eq!(mastery["tasks"].as_array().unwrap().len(), 2);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn accel_replays_and_edits_earlier_scenarios() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, "accel", json!({"filled": 8, "replay": 0.7, "score": "regret"})).await;
    let leased = train(&api, "accel", 22).await;
    let mut seen = BTreeSet::new();
    let mut edits = 0;
    for (group, recipe) in &leased {
        let (scenario, role) = (text(&group["scenario"]), text(&group["role"]));
        match role.as_str() {
            "explore" => assert_eq!(group["train"], false),
            "replay" => {
                assert_eq!(group["train"], true);
                assert!(seen.contains(&scenario), "a replayed scenario was proposed before");
            }
            "edit" => {
                assert_eq!(group["train"], false);
                let lineage = &recipe["layout"]["provenance"];
                assert!(
                    seen.contains(&text(&lineage["edit_of"])),
                    "the parent was proposed before: {lineage}"
                );
                assert!(!lineage["changes"].as_array().unwrap().is_empty());
                assert_ne!(text(&lineage["edit_of"]), scenario, "an edit is another scenario");
                let bracket = &group["bracket"];
                assert!(bracket["reference"].as_f64().unwrap() >= 0.0, "{bracket}");
                edits += 1;
            }
            other => panic!("a group of role {other}"),
        }
        seen.insert(scenario);
    }
    assert!(edits > 20 && with_role(&leased, "replay").len() > 60, "{edits} edits");
    let mastery = api.get("/v1/runs/accel/mastery").await.expect(200);
    let rules = mastery["explanation"]["tasks"][0]["current_state"].as_str().unwrap();
    assert!(rules.contains("kept"), "{rules}");
}

#[tokio::test(flavor = "multi_thread")]
async fn plr_prefers_the_highest_reported_metric() {
    let server = Server::start().await;
    let api = server.api();
    create(
        &api,
        "plr",
        json!({"score": "positive_value_loss", "filled": 4, "replay": 1.0, "staleness": 0.0, "beta": 0.01}),
    )
    .await;
    let mut reported_values = BTreeMap::<String, f64>::new();
    let mut replays = Vec::new();
    for _ in 0..14 {
        let lease = api.lease("plr", json!({"groups": 16})).await;
        let all = groups(&lease);
        for group in &all {
            assert_eq!(group["train"], true);
            if group["role"] == "replay" {
                replays.push(text(&group["scenario"]));
            }
        }
        let reported_value = |index: usize| if index % 16 == 3 { 5.0 } else { 0.01 };
        let episodes = lease.episodes();
        let results = episodes.iter().enumerate().map(|(at, (id, scenario))| {
            let group = at / 2;
            if all[group]["role"] == "explore" {
                reported_values.insert(text(&all[group]["scenario"]), reported_value(group));
            }
            let known = reported_values.get(&text(&all[group]["scenario"])).copied().unwrap_or(0.01);
            let mut result = episode_result(id, scenario, "hold");
            result["metrics"] = json!({"positive_value_loss": known});
            result
        });
        let _ = api.report("plr", results.collect()).await;
    }
    // A temperature of 0.01 draws the scenarios with the highest reported value. The first replays are others, too: proposals that
    // wait together are distinct, and few scenarios have that value at first.
    assert!(replays.len() > 100, "{} replays", replays.len());
    let last = &replays[replays.len() - 64..];
    let best = last.iter().filter(|scenario| reported_values.get(*scenario) == Some(&5.0)).count();
    assert!(best > 51, "{best} of {}", last.len());
}

#[tokio::test(flavor = "multi_thread")]
async fn column_leases_need_a_drawing_strategy() {
    let server = Server::start().await;
    let api = server.api();
    for name in ["plr", "plr_robust", "accel", "learnability", "auto", "staircase", "controller", "bandit"] {
        create(&api, name, json!({})).await;
        let rejected =
            api.post(&format!("/v1/runs/{name}/leases"), json!({"groups": 100, "form": "columns"})).await;
        let problem = rejected.expect(422);
        assert!(problem["detail"].as_str().unwrap().contains("ranges of seeds cannot follow"), "{problem}");
    }
    for name in ["adr", "alp_gmm", "uniform"] {
        create(&api, name, json!({})).await;
        let lease =
            api.post(&format!("/v1/runs/{name}/leases"), json!({"groups": 100, "form": "columns"})).await;
        assert!(lease.expect(201)["ranges"].as_array().unwrap().len() > 1);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn replayed_scenarios_outlive_retention() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"id": "kept", "seed": 9, "strategy": "accel", "strategy_settings": {"filled": 8, "capacity": 24},
                      "tasks": [SURVIVAL], "design": {"designer": "off"}, "retention": {"episodes": 0}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let mut seen = BTreeSet::new();
    let mut replays = 0;
    let db = sqlx::sqlite::SqliteConnectOptions::new().filename(server.db_path());
    let mut conn = sqlx::ConnectOptions::connect(&db).await.unwrap();
    for round in 1..=30 {
        for (group, _) in train(&api, "kept", 1).await {
            replays += usize::from(group["role"] == "replay");
            assert!(group["role"] != "replay" || seen.contains(&text(&group["scenario"])));
            seen.insert(text(&group["scenario"]));
        }
        if round % 10 == 0 {
            wait_until("retention compacts all leases but the newest", async || {
                let sql = "SELECT count(*) FROM leases WHERE is_compacted = 0";
                sqlx::query_scalar::<_, i64>(sql).fetch_one(&mut conn).await.unwrap() <= 1
            })
            .await;
        }
    }
    assert!(replays > 100, "{replays}");
    wait_until("retention removes old proposals, of which there were at least 480", async || {
        let sql = "SELECT count(*) FROM proposals";
        sqlx::query_scalar::<_, i64>(sql).fetch_one(&mut conn).await.unwrap() < 400
    })
    .await;
}

/// Starts near the goal show no mastery of a level, whatever their results, and their chains go on after a restart.
#[tokio::test(flavor = "multi_thread")]
async fn scaled_starts_are_no_evidence() {
    let (mut server, uninterrupted) = (Server::start().await, Server::start().await);
    let mut leased = Vec::new();
    for api in [server.api(), uninterrupted.api()] {
        let request = json!({"id": "near", "seed": 5, "strategy": "staircase", "strategy_settings": {"coverage": 0},
                             "tasks": ["docking/single"], "design": {"designer": "off"}});
        let _ = api.post("/v1/runs", request).await.expect(201);
        leased = train(&api, "near", 6).await;
    }
    for (group, recipe) in &leased {
        assert_eq!((&group["role"], &group["level"]), (&json!("rung"), &Value::Null), "{group}");
        assert!(recipe["params"]["start_scale"].as_f64().unwrap() < 1.0, "{recipe}");
    }
    server.restart().await;
    let after = [train(&server.api(), "near", 4).await, train(&uninterrupted.api(), "near", 4).await];
    let scenarios =
        after.map(|leased| leased.into_iter().map(|(group, _)| text(&group["scenario"])).collect::<Vec<_>>());
    assert_eq!(scenarios[0], scenarios[1], "a restart does not change the proposals");
    let mastery = server.api().get("/v1/runs/near/mastery").await.expect(200);
    let task = &mastery["tasks"][0];
    assert!(task["results"]["successes"].as_u64().unwrap() > 20, "{task}");
    assert_eq!(task["levels"], json!([]), "no slot was opened");
    let sampler = server.api().get("/v1/runs/near/sampler").await.expect(200)["tasks"][0].clone();
    assert!(sampler["quartiles"].is_array(), "{sampler}");
}
