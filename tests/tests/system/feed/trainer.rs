//! A trainer that flies ranges of seeds.

use env_core::{ActionLog, Recipe, Scenario, Seed};
use serde_json::{Value, json};
use std::sync::Arc;
use system_tests::{Api, Lease, flown, wire};

/// A run without placement and designs, for one task.
pub(crate) async fn run(api: &Api, id: &str, more: Value) {
    let mut wish = json!({
        "id": id, "seed": 7, "placement": false, "tasks": ["kessler/survival"], "design": {"designer": "off"},
    });
    wish.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    let _ = api.post("/v1/runs", wish).await.expect(201);
}

/// A lease of columns, with every episode flown.
pub(crate) struct Flight {
    pub(crate) lease: Lease,
    pub(crate) run: String,
    pub(crate) scores: Vec<f64>,
    pub(crate) logs: Vec<ActionLog>,
}

impl Flight {
    /// Leases, and flies by a built-in policy.
    pub(crate) async fn new(api: &Api, run: &str, wish: Value, policy: &str) -> Self {
        let mut asked = json!({"form": "columns"});
        asked.as_object_mut().unwrap().extend(wish.as_object().unwrap().clone());
        let lease = api.lease(run, asked).await;
        let (mut scores, mut logs) = (Vec::new(), Vec::new());
        for scenario in scenarios(&lease) {
            for _ in 0..lease.0["group_size"].as_u64().unwrap() {
                let (flown, log) = flown(&scenario, policy);
                scores.push(flown.score);
                logs.push(log);
            }
        }
        Self { lease, run: run.to_owned(), scores, logs }
    }

    pub(crate) fn path(&self) -> String {
        format!("/v1/runs/{}/leases/{}/columns", self.run, self.lease.id())
    }

    /// Claims what was flown.
    pub(crate) async fn claim(&self, api: &Api) -> Value {
        api.post(&self.path(), json!({"score": self.scores})).await.expect(200)
    }

    /// The logs that are due.
    pub(crate) fn due(&self, claim: &Value) -> Vec<Value> {
        let mut results = Vec::new();
        for audit in claim["audit"].as_array().unwrap() {
            let entries = audit["entries"].as_array().unwrap();
            for (entry, episode) in entries.iter().zip(audit["episodes"].as_array().unwrap()) {
                let log = &self.logs[entry.as_u64().unwrap() as usize];
                results.push(json!({"episode": episode, "actions": wire(log)}));
            }
        }
        results
    }

    /// What became of the claim.
    pub(crate) async fn standing(&self, api: &Api) -> Value {
        api.get(&self.path()).await.expect(200)
    }
}

/// The scenarios of a lease of columns, group by group, as a trainer makes them.
pub(crate) fn scenarios(lease: &Lease) -> Vec<Scenario> {
    let mut all = Vec::new();
    for range in lease.0["ranges"].as_array().unwrap() {
        let recipe = &lease.0["recipes"][range["recipe"].as_u64().unwrap() as usize];
        let recipe = Arc::new(Recipe::from_json(recipe).unwrap());
        assert_eq!(range["first"].as_u64().unwrap() as usize, all.len(), "ranges follow each other");
        let seed = range["seed"].as_u64().unwrap();
        for group in 0..range["groups"].as_u64().unwrap() {
            all.push(Scenario::new(Arc::clone(&recipe), Seed::new(seed + group).unwrap()));
        }
    }
    all
}

/// The words of receipts.
pub(crate) fn words(receipts: &Value) -> Vec<&str> {
    receipts["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect()
}

/// What a run's mastery says of its one task.
pub(crate) async fn mastery(api: &Api, run: &str) -> Value {
    api.get(&format!("/v1/runs/{run}/mastery")).await.expect(200)["tasks"][0].clone()
}
