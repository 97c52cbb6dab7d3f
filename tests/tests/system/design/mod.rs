//! Designs: requests, layouts, their lifecycle and faults of designers. This file has the helpers of these tests.

mod command;
mod docking;
mod faults;
mod lifecycle;
mod llm_designer;
mod sampled;
mod scripted_designer;
mod tasking;

use serde_json::{Value, json};
use system_tests::{ApiClient, Lease, wait_for};

pub(crate) use self::scripted_designer::request_design;

pub(crate) const TASK: &str = "kessler/survival";

/// Creates a run of one task with contested groups only and the given design settings.
pub(crate) async fn create(api: &ApiClient, design: Value) {
    let settings = json!({
        "id": "run", "seed": 11, "strategy": "ladder", "group_size": 2, "placement": false, "contested_share": 1.0, "target": "mastery",
        "tasks": [TASK], "design": design
    });
    let _ = api.post("/v1/runs", settings).await.expect(201);
}

/// Reports 48 episodes of a holding policy on 24 scenarios that holding fails.
pub(crate) async fn report_losses(api: &ApiClient) -> Lease {
    let lease = api.lease("run", json!({"groups": 24})).await;
    api.report("run", lease.results("hold")).await;
    lease
}

/// Requests `path` until the response meets the condition, and returns that response.
pub(crate) async fn wait_for_response(api: &ApiClient, path: &str, is_met: impl Fn(&Value) -> bool) -> Value {
    wait_for(path, async || Some(api.get(path).await.expect(200)).filter(&is_met)).await
}

/// Waits until every episode of the run has its critique, and returns the failure profile.
pub(crate) async fn wait_for_critiques(api: &ApiClient) -> Value {
    wait_for_response(api, "/v1/runs/run", |run| run["critique_backlog"]["waiting"] == 0).await;
    api.get("/v1/runs/run/failure_profiles").await.expect(200)
}

pub(crate) async fn design_summary(api: &ApiClient) -> Value {
    api.get("/v1/runs/run/designs/statistics").await.expect(200)
}
