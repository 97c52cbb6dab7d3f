//! Server rollouts and the trajectory feed. This file has the helpers of these tests.

mod built_in_policies;
pub(crate) mod chat_policy;
mod example;
mod faults;
mod feed;
mod formats;
mod server_kill;

use env_core::log::Precision;
use env_core::rollout::{read_log, replay};
use env_core::{EpisodeOutcome, Recipe, Scenario, Seed, StopReason};
use serde_json::{Value, json};
use system_tests::{ApiClient, ApiResponse, wait_for, wait_until};

/// Creates a run of one task whose scenarios are quick to prepare; `overrides` replaces settings.
pub(crate) async fn create_run(api: &ApiClient, id: &str, overrides: Value) {
    let mut settings = json!({
        "strategy": "ladder", "id": id, "seed": 5, "group_size": 2, "tasks": ["kessler/survival"], "contested_share": 0.0,
        "placement": false, "design": {"designer": "off"},
    });
    settings.as_object_mut().unwrap().extend(overrides.as_object().unwrap().clone());
    let _ = api.post("/v1/runs", settings).await.expect(201);
}

/// Sets the policy of a run.
pub(crate) async fn put_policy(api: &ApiClient, id: &str, settings: Value) -> ApiResponse {
    api.request("PUT", &format!("/v1/runs/{id}/policy"), "application/json", settings.to_string()).await
}

/// Returns the policy of a run with its progress.
pub(crate) async fn policy(api: &ApiClient, id: &str) -> Value {
    api.get(&format!("/v1/runs/{id}/policy")).await.expect(200)
}

/// Claims groups from the feed of a run.
pub(crate) async fn claim(api: &ApiClient, id: &str, request: Value) -> Vec<Value> {
    let page = api.post(&format!("/v1/runs/{id}/trajectories/claim"), request).await.expect(200);
    page["groups"].as_array().unwrap().clone()
}

/// Reads groups from the feed of a run without a claim.
pub(crate) async fn read(api: &ApiClient, id: &str, query: &str) -> Vec<Value> {
    let page = api.get(&format!("/v1/runs/{id}/trajectories?{query}")).await.expect(200);
    page["groups"].as_array().unwrap().clone()
}

/// Acknowledges groups of a run.
pub(crate) async fn ack(api: &ApiClient, id: &str, ids: &[i64]) -> Value {
    api.post(&format!("/v1/runs/{id}/trajectories/ack"), json!({ "ids": ids })).await.expect(200)
}

/// Waits until the policy of a run meets a condition, and returns it.
pub(crate) async fn wait_for_policy(
    api: &ApiClient,
    id: &str,
    condition: &str,
    is_met: impl Fn(&Value) -> bool,
) -> Value {
    wait_for(condition, async || Some(policy(api, id).await).filter(&is_met)).await
}

/// Waits until the feed of a run has as many groups as the settings allow.
pub(crate) async fn wait_for_full_feed(api: &ApiClient, id: &str) -> Value {
    wait_for_policy(api, id, "the feed is full", |policy| policy["feed"]["full"] == true).await
}

/// Fetches all leases of the run `run`.
pub(crate) async fn all_leases(api: &ApiClient) -> Vec<Value> {
    let (mut all, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = api.get(&format!("/v1/runs/run/leases?limit=500{cursor}")).await.expect(200);
        all.extend(page["leases"].as_array().unwrap().clone());
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return all,
        }
    }
}

/// Waits until no lease of the run `run` is active, that is, until all server rollouts have ended.
pub(crate) async fn wait_for_rollouts(api: &ApiClient) {
    wait_until("all server rollouts end", async || {
        all_leases(api).await.iter().all(|lease| lease["status"] != "active")
    })
    .await;
}

pub(crate) fn number(value: &Value) -> i64 {
    value.as_i64().unwrap_or_else(|| panic!("{value} is no integer"))
}

pub(crate) fn ids(groups: &[Value]) -> Vec<i64> {
    groups.iter().map(|group| number(&group["id"])).collect()
}

/// Returns the number of episodes that count for the mastery of a run.
pub(crate) async fn counted_episodes(api: &ApiClient, id: &str) -> i64 {
    let mastery = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200);
    mastery["tasks"].as_array().unwrap().iter().map(|task| number(&task["results"]["episodes"])).sum()
}

/// Builds the scenario of a group.
pub(crate) fn group_scenario(group: &Value) -> Scenario {
    let recipe = Recipe::from_json(&group["recipe"]).unwrap();
    Scenario::new(recipe, Seed::new(group["seed"].as_u64().unwrap()).unwrap())
}

/// Replays the actions of an episode.
pub(crate) fn replay_episode(scenario: &Scenario, episode: &Value) -> EpisodeOutcome {
    let steps = episode["steps"].as_array().unwrap().iter().map(|step| step["action"].clone());
    let steps: Vec<Value> = steps.filter(|action| !action.is_null()).collect();
    let stopped = episode["stopped"].as_str().map(|word| StopReason::from_name(word).unwrap());
    let log = read_log(scenario, &steps, Precision::F64, stopped).unwrap();
    replay(scenario, &log).unwrap()
}

/// Checks that scores, rewards and ends of a group equal a replay of its actions.
pub(crate) fn assert_group_replays(group: &Value) {
    let scenario = group_scenario(group);
    assert_eq!(group["scenario"], scenario.id().to_string());
    assert_eq!(group["task"], scenario.task().id());
    for episode in group["episodes"].as_array().unwrap() {
        let outcome = replay_episode(&scenario, episode);
        assert_eq!(episode["score"], outcome.score);
        let steps = episode["steps"].as_array().unwrap();
        let total: f64 = steps.iter().map(|step| step["reward"].as_f64().unwrap()).sum();
        // Sums of the same numbers, in another order if the episode stopped early.
        assert!((total - outcome.total_reward).abs() < 1e-12, "{total} {}", outcome.total_reward);
        let done: Vec<bool> = steps.iter().map(|step| step["done"].as_bool().unwrap()).collect();
        assert!(done.iter().rev().skip(1).all(|done| !done) && *done.last().unwrap(), "{done:?}");
        for step in steps {
            let ends = step["agents"].as_array().unwrap();
            assert!(!ends.is_empty() || step["done"] == true);
            for end in ends {
                let is_done = end["terminated"] == true || end["truncated"] == true;
                assert!(is_done || step["done"] == false, "{step}");
            }
        }
    }
}
