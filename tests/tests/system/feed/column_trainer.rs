//! A trainer that claims the scores of a lease of columns.

use env_core::{ActionLog, Recipe, Scenario, Seed};
use serde_json::{Value, json};
use std::sync::Arc;
use system_tests::{ApiClient, Lease, log_to_json, run_policy};

/// Creates a run of one task without placement and designs; `overrides` replaces settings.
pub(crate) async fn create_run(api: &ApiClient, id: &str, overrides: Value) {
    let mut request = json!({
        "strategy": "ladder", "id": id, "seed": 7, "placement": false, "tasks": ["kessler/survival"], "design": {"designer": "off"},
    });
    request.as_object_mut().unwrap().extend(overrides.as_object().unwrap().clone());
    let _ = api.post("/v1/runs", request).await.expect(201);
}

/// Lease of columns with scores and logs of all its episodes.
pub(crate) struct ColumnClaim {
    pub(crate) lease: Lease,
    pub(crate) run: String,
    pub(crate) scores: Vec<f64>,
    pub(crate) logs: Vec<ActionLog>,
}

impl ColumnClaim {
    /// Leases columns and runs every episode with a built-in policy.
    pub(crate) async fn new(api: &ApiClient, run: &str, request: Value, policy: &str) -> Self {
        let mut lease_request = json!({"form": "columns"});
        lease_request.as_object_mut().unwrap().extend(request.as_object().unwrap().clone());
        let lease = api.lease(run, lease_request).await;
        let (mut scores, mut logs) = (Vec::new(), Vec::new());
        for scenario in scenarios(&lease) {
            for _ in 0..lease.0["group_size"].as_u64().unwrap() {
                let rollout = run_policy(&scenario, policy);
                scores.push(rollout.outcome.score);
                logs.push(rollout.log);
            }
        }
        Self { lease, run: run.to_owned(), scores, logs }
    }

    pub(crate) fn path(&self) -> String {
        format!("/v1/runs/{}/leases/{}/columns", self.run, self.lease.id())
    }

    /// Claims the scores and returns the claim with its audit.
    pub(crate) async fn claim(&self, api: &ApiClient) -> Value {
        api.post(&self.path(), json!({"score": self.scores})).await.expect(200)
    }

    /// Returns the results that the audit of a claim requires.
    pub(crate) fn audited_results(&self, claim: &Value) -> Vec<Value> {
        let mut results = Vec::new();
        for audit in claim["audited_groups"].as_array().unwrap() {
            let entries = audit["entries"].as_array().unwrap();
            for (entry, episode) in entries.iter().zip(audit["episodes"].as_array().unwrap()) {
                let log = &self.logs[entry.as_u64().unwrap() as usize];
                results.push(json!({"episode": episode, "actions": log_to_json(log)}));
            }
        }
        results
    }

    /// Requests the state of the claim.
    pub(crate) async fn claim_state(&self, api: &ApiClient) -> Value {
        api.get(&self.path()).await.expect(200)
    }
}

/// Builds the scenarios of a lease of columns, group by group, as a trainer does.
pub(crate) fn scenarios(lease: &Lease) -> Vec<Scenario> {
    let mut all = Vec::new();
    for range in lease.0["ranges"].as_array().unwrap() {
        let recipe = &lease.0["recipes"][range["recipe"].as_u64().unwrap() as usize];
        let recipe = Arc::new(Recipe::from_json(recipe).unwrap());
        assert_eq!(range["first_group"].as_u64().unwrap() as usize, all.len(), "ranges follow each other");
        let seed = range["seed"].as_u64().unwrap();
        for group in 0..range["groups"].as_u64().unwrap() {
            all.push(Scenario::new(Arc::clone(&recipe), Seed::new(seed + group).unwrap()));
        }
    }
    all
}

/// Returns the status of each receipt.
pub(crate) fn statuses(receipts: &Value) -> Vec<&str> {
    receipts["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect()
}

/// Returns the mastery of the only task of a run.
pub(crate) async fn task_mastery(api: &ApiClient, run: &str) -> Value {
    api.get(&format!("/v1/runs/{run}/mastery")).await.expect(200)["tasks"][0].clone()
}
