//! Curricula against a real server: strategies, changes of a run, refills, evaluations and policy versions.

mod evaluations;
mod policy_versions;
mod refills;
mod run_changes;
mod strategies;

use serde_json::Value;
use system_tests::Lease;

const SURVIVAL: &str = "kessler/survival";
const ECO: &str = "kessler/eco_station";

fn groups(lease: &Lease) -> Vec<Value> {
    lease.0["groups"].as_array().unwrap().clone()
}
