//! Policies that the server flies itself, and the feed of what they flew.

mod built_in;
mod chat;
mod example;
mod faults;
mod feed;
mod forms;
mod killed;

use std::time::{Duration, Instant};

use env_core::log::Precision;
use env_core::rollout::{read_log, replay};
use env_core::{Flown, Recipe, Scenario, Seed, Stopped};
use serde_json::{Value, json};
use system_tests::{Answer, Api};

/// How long something may take that should happen soon.
const SOON: Duration = Duration::from_secs(60);

/// A run of one easy task whose scenarios come as they are: quick to prepare.
pub(crate) async fn run(api: &Api, id: &str, more: Value) {
    let mut wish = json!({
        "id": id, "seed": 5, "group_size": 2, "tasks": ["kessler/survival"], "contested_share": 0.0,
        "placement": false, "design": {"designer": "off"},
    });
    wish.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    let _ = api.post("/v1/runs", wish).await.expect(201);
}

/// Sets the policy of a run.
pub(crate) async fn put(api: &Api, id: &str, wish: Value) -> Answer {
    api.raw("PUT", &format!("/v1/runs/{id}/policy"), "application/json", wish.to_string()).await
}

/// The policy of a run, and how it goes.
pub(crate) async fn policy(api: &Api, id: &str) -> Value {
    api.get(&format!("/v1/runs/{id}/policy")).await.expect(200)
}

/// Pulls groups.
pub(crate) async fn pull(api: &Api, id: &str, query: &str) -> Vec<Value> {
    let told = api.get(&format!("/v1/runs/{id}/trajectories?{query}")).await.expect(200);
    told["groups"].as_array().unwrap().clone()
}

/// Acknowledges groups.
pub(crate) async fn ack(api: &Api, id: &str, ids: &[i64]) -> Value {
    api.post(&format!("/v1/runs/{id}/trajectories/ack"), json!({ "ids": ids })).await.expect(200)
}

/// Waits until the policy of a run is as it should be.
pub(crate) async fn until(api: &Api, id: &str, what: &str, is: impl Fn(&Value) -> bool) -> Value {
    let begun = Instant::now();
    loop {
        let told = policy(api, id).await;
        if is(&told) {
            return told;
        }
        assert!(begun.elapsed() < SOON, "never {what}: {told}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

pub(crate) fn number(value: &Value) -> i64 {
    value.as_i64().unwrap_or_else(|| panic!("{value} is no number"))
}

pub(crate) fn ids(groups: &[Value]) -> Vec<i64> {
    groups.iter().map(|group| number(&group["id"])).collect()
}

/// Episodes that the run counts, whatever they were worth.
pub(crate) async fn counted(api: &Api, id: &str) -> i64 {
    let standing = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200);
    standing["tasks"].as_array().unwrap().iter().map(|task| number(&task["plain"]["episodes"])).sum()
}

/// A group's scenario.
pub(crate) fn scenario(group: &Value) -> Scenario {
    let recipe = Recipe::from_json(&group["recipe"]).unwrap();
    Scenario::new(recipe, Seed::new(group["seed"].as_u64().unwrap()).unwrap())
}

/// What the actions of an episode earn.
pub(crate) fn replayed(scenario: &Scenario, episode: &Value) -> Flown {
    let steps = episode["steps"].as_array().unwrap().iter().map(|step| step["action"].clone());
    let steps: Vec<Value> = steps.filter(|action| !action.is_null()).collect();
    let stopped = episode["stopped"].as_str().map(|word| Stopped::from_word(word).unwrap());
    let log = read_log(scenario, &steps, Precision::F64, stopped).unwrap();
    replay(scenario, &log).unwrap()
}

/// Every number of a group is what its actions earn.
pub(crate) fn check(group: &Value) {
    let scenario = scenario(group);
    assert_eq!(group["scenario"], scenario.id().to_string());
    assert_eq!(group["task"], scenario.task().id());
    for episode in group["episodes"].as_array().unwrap() {
        let flown = replayed(&scenario, episode);
        assert_eq!(episode["score"], flown.score);
        let steps = episode["steps"].as_array().unwrap();
        let total: f64 = steps.iter().map(|step| step["reward"].as_f64().unwrap()).sum();
        // The same numbers summed; where an episode stopped, in another order.
        assert!((total - flown.total).abs() < 1e-12, "{total} {}", flown.total);
        let done: Vec<bool> = steps.iter().map(|step| step["done"].as_bool().unwrap()).collect();
        assert!(done.iter().rev().skip(1).all(|done| !done) && *done.last().unwrap(), "{done:?}");
        for step in steps {
            let ends = step["agents"].as_array().unwrap();
            assert!(!ends.is_empty() || step["done"] == true);
            for end in ends {
                let gone = end["terminated"] == true || end["truncated"] == true;
                assert!(gone || step["done"] == false, "{step}");
            }
        }
    }
}
