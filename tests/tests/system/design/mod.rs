//! Designs; here is what their tests share: a run that loses, and waiting.

mod command;
mod fake;
mod faults;
mod life;
mod model;

use std::time::Duration;

use serde_json::{Value, json};
use system_tests::{Api, Lease, result};

pub(crate) const TASK: &str = "kessler/survival";

/// A run of one task in which everything is contested, with designs as told.
pub(crate) async fn create(api: &Api, design: Value) {
    let wish = json!({
        "id": "run", "seed": 11, "group_size": 2, "placement": false, "contested_share": 1.0, "target": "mastery",
        "tasks": [TASK], "design": design
    });
    let _ = api.post("/v1/runs", wish).await.expect(201);
}

/// Flies 24 scenarios, which who holds loses, by holding: 48 episodes with failures.
pub(crate) async fn lose(api: &Api) -> Lease {
    let lease = api.lease("run", json!({"groups": 24})).await;
    let held = lease.episodes().iter().map(|(episode, scenario)| result(episode, scenario, "hold")).collect();
    api.report("run", held).await;
    lease
}

/// GET until it is so; at most a minute.
pub(crate) async fn until(api: &Api, path: &str, so: impl Fn(&Value) -> bool) -> Value {
    for _ in 0..1200 {
        let answer = api.get(path).await.expect(200);
        if so(&answer) {
            return answer;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("{path} does not become what is waited for: {:#}", api.get(path).await.body);
}

/// The run's failures, once nothing waits for its critique.
pub(crate) async fn caught_up(api: &Api) -> Value {
    until(api, "/v1/runs/run", |run| run["critique"]["waiting"] == 0).await;
    api.get("/v1/runs/run/failures").await.expect(200)
}

pub(crate) async fn summary(api: &Api) -> Value {
    api.get("/v1/runs/run/designs/summary").await.expect(200)
}
