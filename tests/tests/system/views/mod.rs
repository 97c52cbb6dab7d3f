//! Read models of the dashboard: series, samplers, searches, overviews and flights, compared with the data that they summarise.

mod details;
mod sampler;
mod search;
mod series;

use serde_json::{Value, json};
use system_tests::{ApiClient, episode_result};

/// Creates a run of one task without designs and placement; `overrides` replaces settings.
async fn create_run(api: &ApiClient, overrides: Value) {
    let mut settings = json!({"strategy": "ladder", "id": "run", "seed": 9, "placement": false, "tasks": ["kessler/survival"],
                         "design": {"designer": "off"}});
    for (key, value) in overrides.as_object().expect("an object") {
        settings[key] = value.clone();
    }
    let _ = api.post("/v1/runs", settings).await.expect(201);
}

/// Leases groups and reports every third episode as failed, the others as run by `policy`; returns all episode ids.
async fn report_groups(api: &ApiClient, groups: u32, policy: &str) -> Vec<String> {
    let lease = api.lease("run", json!({"groups": groups})).await;
    let episodes = lease.episodes();
    let results = episodes.iter().enumerate().map(|(i, (name, scenario))| match i % 3 {
        0 => json!({"episode": name, "status": "failed", "reason": "the worker was preempted"}),
        _ => episode_result(name, scenario, policy),
    });
    api.report("run", results.collect()).await;
    episodes.into_iter().map(|(name, _)| name).collect()
}
