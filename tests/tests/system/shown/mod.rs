//! What the dashboard shows: numbers that are there to be looked at are held to those that everything else rests on.

mod others;
mod search;
mod series;

use serde_json::{Value, json};
use system_tests::{Api, result};

/// A run of survival without designs or placement.
async fn run(api: &Api, wish: Value) {
    let mut all = json!({"id": "run", "seed": 9, "placement": false, "tasks": ["kessler/survival"],
                         "design": {"designer": "off"}});
    for (key, value) in wish.as_object().expect("an object") {
        all[key] = value.clone();
    }
    let _ = api.post("/v1/runs", all).await.expect(201);
}

/// Leases so many groups and reports them: the first third failed, the others were flown by the heuristic, or nobody acted in them.
async fn fly(api: &Api, groups: u32, policy: &str) -> Vec<String> {
    let lease = api.lease("run", json!({"groups": groups})).await;
    let episodes = lease.episodes();
    let results = episodes.iter().enumerate().map(|(i, (name, scenario))| match i % 3 {
        0 => json!({"episode": name, "status": "failed", "reason": "the worker was preempted"}),
        _ => result(name, scenario, policy),
    });
    api.report("run", results.collect()).await;
    episodes.into_iter().map(|(name, _)| name).collect()
}
