//! Curricula against a real server: strategies, changes of a run, refills, evaluations and policy versions.

mod evaluations;
mod policy_versions;
mod refills;
mod run_changes;
mod strategies;

use serde_json::Value;
use system_tests::{ApiClient, Lease, wait_for};

const SURVIVAL: &str = "kessler/survival";
const ECO: &str = "kessler/eco_station";

/// Leases groups of a run; retries while the server prepares scenarios.
async fn lease(api: &ApiClient, run: &str, request: Value) -> Lease {
    let path = format!("/v1/runs/{run}/leases");
    let response = wait_for("scenarios are prepared", async || {
        let response = api.post(&path, request.clone()).await;
        (response.status != 503).then_some(response)
    });
    Lease(response.await.expect(201))
}

fn groups(lease: &Lease) -> Vec<Value> {
    lease.0["groups"].as_array().unwrap().clone()
}
