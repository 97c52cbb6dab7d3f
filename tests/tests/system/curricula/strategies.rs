//! What strategies hand out: the same scenario again, edits with their lineage, groups that are not learnt from.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::{Value, json};
use system_tests::{Api, Server, result};

use super::{ECO, SURVIVAL, groups, lease};

/// Flies so many leases of 16 groups; all groups, each with the recipe it names.
async fn flown(api: &Api, run: &str, leases: usize) -> Vec<(Value, Value)> {
    let mut all = Vec::new();
    for number in 0..leases {
        let lease = lease(api, run, json!({"groups": 16})).await;
        let policy = if number % 2 == 0 { "hold" } else { "heuristic" };
        let results = lease.episodes().iter().map(|(id, scenario)| result(id, scenario, policy)).collect();
        let told = api.report(run, results).await;
        let counted = told["results"].as_array().unwrap().iter().all(|one| one["status"] == "counted");
        assert!(counted, "{told}");
        for group in groups(&lease) {
            let recipe = lease.0["recipes"][group["recipe"].as_u64().unwrap() as usize].clone();
            all.push((group, recipe));
        }
    }
    all
}

async fn create(api: &Api, strategy: &str, settings: Value) {
    let wish = json!({"id": strategy, "seed": 5, "strategy": strategy, "strategy_settings": settings, "group_size": 2,
                      "tasks": [SURVIVAL, ECO], "design": {"designer": "off"}});
    let run = api.post("/v1/runs", wish).await.expect(201);
    assert_eq!(run["settings"]["curriculum"]["strategy"], strategy);
}

fn of_role<'a>(flown: &'a [(Value, Value)], role: &str) -> Vec<&'a (Value, Value)> {
    flown.iter().filter(|(group, _)| group["role"] == role).collect()
}

fn text(value: &Value) -> String {
    value.as_str().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn every_strategy_hands_out_flies_and_goes_on_after_a_restart() {
    let listed = Server::start().await.api().get("/v1/strategies").await.expect(200);
    let names: Vec<String> =
        listed["strategies"].as_array().unwrap().iter().map(|s| text(&s["name"])).collect();
    assert_eq!(names.len(), 9, "{names:?}");
    for name in names {
        let (mut server, steady) = (Server::start().await, Server::start().await);
        for api in [server.api(), steady.api()] {
            create(&api, &name, json!({})).await;
            let _ = flown(&api, &name, 4).await;
        }
        server.restart().await;
        let after = [flown(&server.api(), &name, 4).await, flown(&steady.api(), &name, 4).await];
        let told = after
            .map(|flown| flown.into_iter().map(|(group, _)| group["scenario"].clone()).collect::<Vec<_>>());
        assert_eq!(told[0], told[1], "{name}: a restart changes nothing of what is proposed");
        let mastery = server.api().get(&format!("/v1/runs/{name}/mastery")).await.expect(200);
        assert_eq!(mastery["explanation"]["strategy"], *name);
        assert!(!mastery["explanation"]["rules"].as_array().unwrap().is_empty(), "{mastery}");
        assert_eq!(mastery["tasks"].as_array().unwrap().len(), 2);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn accel_replays_and_edits_what_it_kept_and_says_what_not_to_learn_from() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, "accel", json!({"filled": 8, "replay": 0.7})).await;
    let flown = flown(&api, "accel", 22).await;
    let mut seen = BTreeSet::new();
    let mut edits = 0;
    for (group, recipe) in &flown {
        let (scenario, role) = (text(&group["scenario"]), text(&group["role"]));
        match role.as_str() {
            "explore" => assert_eq!(group["train"], false),
            "replay" => {
                assert_eq!(group["train"], true);
                assert!(seen.contains(&scenario), "what is faced again was faced before");
            }
            "edit" => {
                assert_eq!(group["train"], false);
                let lineage = &recipe["layout"]["provenance"];
                assert!(seen.contains(&text(&lineage["edit_of"])), "its parent was faced before: {lineage}");
                assert!(!lineage["changes"].as_array().unwrap().is_empty());
                assert_ne!(text(&lineage["edit_of"]), scenario, "it is another scenario");
                let bracket = &group["bracket"];
                assert!(bracket["reference"].as_f64().unwrap() >= 0.0, "{bracket}");
                edits += 1;
            }
            other => panic!("a group of role {other}"),
        }
        seen.insert(scenario);
    }
    assert!(edits > 20 && of_role(&flown, "replay").len() > 60, "{edits} edits");
    let mastery = api.get("/v1/runs/accel/mastery").await.expect(200);
    let rules = mastery["explanation"]["tasks"][0]["now"].as_str().unwrap();
    assert!(rules.contains("kept"), "{rules}");
}

#[tokio::test(flavor = "multi_thread")]
async fn plr_goes_by_what_the_trainer_reports_where_it_is_told_so() {
    let server = Server::start().await;
    let api = server.api();
    create(
        &api,
        "plr",
        json!({"score": "positive_value_loss", "filled": 4, "replay": 1.0, "staleness": 0.0, "beta": 0.01}),
    )
    .await;
    let mut worths = BTreeMap::<String, f64>::new();
    let mut replays = Vec::new();
    for _ in 0..14 {
        let lease = lease(&api, "plr", json!({"groups": 16})).await;
        let all = groups(&lease);
        for group in &all {
            assert_eq!(group["train"], true);
            if group["role"] == "replay" {
                replays.push(text(&group["scenario"]));
            }
        }
        let worth = |index: usize| if index % 16 == 3 { 5.0 } else { 0.01 };
        let episodes = lease.episodes();
        let results = episodes.iter().enumerate().map(|(at, (id, scenario))| {
            let group = at / 2;
            if all[group]["role"] == "explore" {
                worths.insert(text(&all[group]["scenario"]), worth(group));
            }
            let known = worths.get(&text(&all[group]["scenario"])).copied().unwrap_or(0.01);
            let mut told = result(id, scenario, "hold");
            told["metrics"] = json!({"positive_value_loss": known});
            told
        });
        let _ = api.report("plr", results.collect()).await;
    }
    // A temperature of 0.01 draws the first: whatever was reported highest.
    let best = replays.iter().filter(|scenario| worths.get(*scenario) == Some(&5.0)).count();
    assert!(replays.len() > 30 && best * 10 > replays.len() * 8, "{best} of {}", replays.len());
}

#[tokio::test(flavor = "multi_thread")]
async fn columns_are_for_strategies_that_draw() {
    let server = Server::start().await;
    let api = server.api();
    for name in ["plr", "plr_robust", "accel", "learnability"] {
        create(&api, name, json!({})).await;
        let refused =
            api.post(&format!("/v1/runs/{name}/leases"), json!({"groups": 100, "form": "columns"})).await;
        let problem = refused.expect(422);
        assert!(problem["detail"].as_str().unwrap().contains("ranges of seeds"), "{problem}");
    }
    for name in ["adr", "alp_gmm", "uniform"] {
        create(&api, name, json!({})).await;
        let lease =
            api.post(&format!("/v1/runs/{name}/leases"), json!({"groups": 100, "form": "columns"})).await;
        assert!(lease.expect(201)["ranges"].as_array().unwrap().len() > 1);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_curriculum_holds_outlives_retention() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "kept", "seed": 9, "strategy": "accel", "strategy_settings": {"filled": 8, "capacity": 24},
                      "tasks": [SURVIVAL], "design": {"designer": "off"}, "retention": {"episodes": 0}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let mut seen = BTreeSet::new();
    let mut again = 0;
    for _ in 0..30 {
        for (group, _) in flown(&api, "kept", 1).await {
            again += usize::from(group["role"] == "replay");
            assert!(group["role"] != "replay" || seen.contains(&text(&group["scenario"])));
            seen.insert(text(&group["scenario"]));
        }
        tokio::time::sleep(std::time::Duration::from_millis(150)).await;
    }
    assert!(again > 100, "{again}");
    let conn = sqlx::sqlite::SqliteConnectOptions::new().filename(server.db());
    let mut conn = sqlx::ConnectOptions::connect(&conn).await.unwrap();
    let left: i64 = sqlx::query_scalar("SELECT count(*) FROM proposals").fetch_one(&mut conn).await.unwrap();
    assert!(left < 400, "of 480 and more proposals the old ones go: {left}");
}
