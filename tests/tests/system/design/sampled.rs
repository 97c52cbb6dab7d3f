//! Designs under a sampler, and their share: the agent's results decide.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use system_tests::{ApiClient, Lease, Server};

use super::lifecycle::{layouts_of, wait_for_stock};
use super::{TASK, create, design_summary, report_losses};
use crate::retention::query_numbers;

/// Results that replay the planner's plan of each scenario.
fn planned_results(lease: &Lease) -> Vec<Value> {
    let mut plans = BTreeMap::new();
    let plan = |(episode, scenario): (String, env_core::Scenario)| {
        let actions = plans.entry(scenario.id()).or_insert_with(|| {
            let bracket = env_core::admission::admit(&scenario).bracket.unwrap();
            system_tests::log_to_json(&bracket.reference_plan)
        });
        json!({"episode": episode, "actions": actions})
    };
    lease.episodes().into_iter().map(plan).collect()
}

/// Creates a run under a staircase whose training groups are all designed once there are layouts.
async fn create_sampled(api: &ApiClient) {
    let settings = json!({
        "id": "run", "seed": 11, "group_size": 2, "strategy": "staircase", "strategy_settings": {"coverage": 0.0},
        "tasks": [TASK], "design": {"share": 1.0, "fixed_share": true, "layout_share": 1.0, "reserve": 4}
    });
    let _ = api.post("/v1/runs", settings).await.expect(201);
}

/// Position of the chains above which a quarter of them is.
async fn upper_quartile(api: &ApiClient) -> f64 {
    let samplers = api.get("/v1/runs/run/sampler").await.expect(200);
    samplers["tasks"][0]["quartiles"][2].as_f64().unwrap_or(0.0)
}

/// Designed groups keep the proposals of a sampler: it learns from them, and mastery does not.
#[tokio::test]
async fn sampler_learns_from_designed_groups() {
    let server = Server::start().await;
    let api = server.api();
    create_sampled(&api).await;
    report_losses(&api).await;
    wait_for_stock(&api, 4).await;
    let before = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(upper_quartile(&api).await, 0.0, "all chains are at the easiest level");
    let lease = api.lease("run", json!({"groups": 12})).await;
    assert!(layouts_of(&lease).iter().all(Option::is_some), "all groups are designed");
    for group in lease.0["groups"].as_array().unwrap() {
        assert_eq!(group["role"], "designed");
        assert!(group["level"].as_u64().unwrap() <= 1, "chains at level 0 get layouts near it: {group}");
    }
    let report = api.report("run", planned_results(&lease)).await;
    let statuses = report["results"].as_array().unwrap().iter().map(|result| result["status"].clone());
    assert_eq!(statuses.collect::<Vec<_>>(), vec![json!("stored"); 24], "designed groups are no evidence");
    let after = api.get("/v1/runs/run/mastery").await.expect(200);
    assert_eq!(upper_quartile(&api).await, 0.5, "two successes move a chain by half a rung");
    assert_eq!(after["tasks"][0]["levels"], before["tasks"][0]["levels"]);
    assert_eq!(after["tasks"][0]["results"], before["tasks"][0]["results"]);
    assert_eq!(after["tasks"][0]["designed_results"]["episodes"], 24);
}

/// Proposals that a layout replaced are not lost with a released lease.
#[tokio::test]
async fn released_designed_groups_return_their_proposals() {
    let server = Server::start().await;
    let api = server.api();
    create_sampled(&api).await;
    report_losses(&api).await;
    wait_for_stock(&api, 4).await;
    let lease = api.lease("run", json!({"groups": 6})).await;
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", lease.id()), json!({})).await.expect(200);
    let shown = api.get(&format!("/v1/runs/run/leases/{}", lease.id())).await.expect(200);
    assert!(shown["groups"].as_array().unwrap().iter().all(|group| group["state"] == "lost"));
    assert_eq!(upper_quartile(&api).await, 0.0);
    let _ = api.lease("run", json!({"groups": 6})).await;
    let first = query_numbers(&server, "SELECT proposal FROM groups WHERE lease = 2 ORDER BY proposal").await;
    let second =
        query_numbers(&server, "SELECT proposal FROM groups WHERE lease = 3 ORDER BY proposal").await;
    assert_eq!((first.len(), second), (6, first));
    // No trainer received their scenarios, so that they still count as new.
    let attempts =
        query_numbers(&server, "SELECT DISTINCT attempts FROM proposals WHERE state = 'leased'").await;
    assert_eq!(attempts, [1]);
}

/// The share of designed groups follows the variance within groups, and is kept over a restart.
#[tokio::test]
async fn share_follows_the_learning_signals() {
    let mut server = Server::start().await;
    let api = server.api();
    create(&api, json!({"share": 1.0, "layout_share": 1.0, "reserve": 4})).await;
    let share = async |api: &ApiClient| design_summary(api).await["next_share"].as_f64().unwrap();
    assert!((share(&api).await - 0.5).abs() < 1e-12, "nothing is known");
    // A holding policy always fails, so ordinary groups have no variance.
    report_losses(&api).await;
    let hopeful = share(&api).await;
    assert!(hopeful > 0.9, "{hopeful}");
    wait_for_stock(&api, 4).await;
    let lease = api.lease("run", json!({"groups": 16})).await;
    assert!(layouts_of(&lease).iter().flatten().count() > 8, "most groups are designed");
    api.report("run", lease.results("hold")).await;
    let summary = design_summary(&api).await;
    let sober = summary["next_share"].as_f64().unwrap();
    assert!(sober < hopeful - 0.1, "designed groups have no variance either: {sober} after {hopeful}");
    let signal = &summary["designed_signal"];
    assert!(signal["groups"].as_f64() > Some(8.0) && signal["mean"].as_f64() < Some(0.06), "{signal}");
    server.restart().await;
    assert_eq!(share(&server.api()).await, sober);
}
