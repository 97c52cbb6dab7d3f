//! The planner's plan of a scenario, and avoiding actions in critiques, are not disclosed to clients that can report them. This file
//! has the helpers of these tests.

mod disclosure;
mod reused_seeds;
mod server_scenarios;

use std::ops::Range;

use env_core::Scenario;
use serde_json::{Value, json};
use system_tests::{ApiClient, ApiResponse, Lease, episode_result, run_policy};

const TASK: &str = "kessler/survival";

async fn create_run(api: &ApiClient, id: &str, settings: Value) -> Value {
    let mut request = json!({
        "strategy": "ladder", "id": id, "seed": 11, "group_size": 2, "placement": false, "contested_share": 1.0, "tasks": [TASK],
        "design": {"designer": "off"}
    });
    for (key, value) in settings.as_object().unwrap() {
        request[key] = value.clone();
    }
    api.post("/v1/runs", request).await.expect(201)
}

async fn replay(api: &ApiClient, run: &str, episode: &str, plan: &str) -> ApiResponse {
    api.get(&format!("/v1/runs/{run}/episodes/{episode}/replay?plan={plan}")).await
}

async fn critique(api: &ApiClient, run: &str, episode: &str) -> Value {
    api.get(&format!("/v1/runs/{run}/episodes/{episode}/critique")).await.expect(200)
}

/// Checks that the server refuses the plan with this status and code, and a sentence that contains a text.
fn assert_refused(response: &ApiResponse, status: u16, code: &str, text: &str) {
    let (kind, detail) = (&response.body["type"], response.body["detail"].as_str().unwrap_or_default());
    assert_eq!(
        (response.status, kind),
        (status, &json!(format!("urn:sparring:problem:{code}"))),
        "{}",
        response.body
    );
    assert!(detail.contains(text), "{detail}");
}

/// Checks that a critique names no avoiding action, and says why.
fn assert_withheld(critique: &Value, reason: &str) {
    assert!(critique["withheld"].as_str().is_some_and(|text| text.contains(reason)), "{critique}");
    let failures = critique["failures"].as_array().unwrap();
    assert!(!failures.is_empty(), "a holding agent fails: {critique}");
    for failure in failures {
        assert!(failure["encounter"]["cheapest_avoidance"].is_null(), "{failure}");
        assert_eq!(failure["measures"], json!([]), "{failure}");
        let explanation = failure["explanation"].as_str().unwrap();
        assert!(!explanation.is_empty() && !explanation.contains("avoided"), "{failure}");
    }
}

/// Checks that a critique is complete and names an avoiding action.
fn assert_complete(critique: &Value) {
    assert!(critique["withheld"].is_null(), "{critique}");
    let failures = critique["failures"].as_array().unwrap();
    assert!(
        failures.iter().any(|failure| failure["encounter"]["cheapest_avoidance"].is_object()),
        "{critique}"
    );
}

/// Group of a lease whose critique of a holding agent names an avoiding action.
struct KnownGroup {
    episodes: Vec<String>,
    scenario: Scenario,
}

impl KnownGroup {
    fn find(lease: &Lease) -> Self {
        let groups = lease.0["groups"].as_array().unwrap().iter();
        let mut groups = groups.map(|group| Self {
            episodes: serde_json::from_value(group["episodes"].clone()).unwrap(),
            scenario: lease.scenario(group),
        });
        groups.find(|group| has_avoiding_action(&group.scenario)).expect("a scenario that a burn saves")
    }

    /// Returns the results of some episodes of the group, in which the agent holds.
    fn results(&self, episodes: Range<usize>) -> Vec<Value> {
        self.episodes[episodes].iter().map(|id| episode_result(id, &self.scenario, "hold")).collect()
    }

    /// Reports some episodes of the group, in which the agent holds.
    async fn report(&self, api: &ApiClient, run: &str, episodes: Range<usize>) {
        let response = api.report(run, self.results(episodes)).await;
        let status = response["results"][0]["status"].as_str();
        assert!(status == Some("counted") || status == Some("stored"), "{response}");
    }
}

/// Returns true if the critique of a holding agent names an avoiding action.
fn has_avoiding_action(scenario: &Scenario) -> bool {
    let critique = scenario.task().critique(scenario, &run_policy(scenario, "hold").log).unwrap();
    let mut encounters = critique.failures.iter().filter_map(|failure| failure.encounter.as_ref());
    encounters.any(|encounter| encounter.cheapest_avoidance.is_some())
}
