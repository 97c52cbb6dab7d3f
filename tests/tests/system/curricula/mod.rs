//! Every curriculum against a real server, a real database and real worlds.

mod changing;
mod evaluations;
mod refills;
mod strategies;
mod versions;

use std::time::Duration;

use serde_json::Value;
use system_tests::{Api, Lease};

const SURVIVAL: &str = "kessler/survival";
const ECO: &str = "kessler/eco_station";

/// Takes a lease, waiting while scenarios are prepared.
async fn lease(api: &Api, run: &str, wish: Value) -> Lease {
    for _ in 0..200 {
        let answer = api.post(&format!("/v1/runs/{run}/leases"), wish.clone()).await;
        if answer.status != 503 {
            return Lease(answer.expect(201));
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("no scenarios come for {wish}");
}

fn groups(lease: &Lease) -> Vec<Value> {
    lease.0["groups"].as_array().unwrap().clone()
}
