//! Plans of scenarios that trainers receive in other ways: sessions that the server steps, designed layouts, and suites.

use env_core::Scenario;
use serde_json::json;
use system_tests::{ApiClient, Lease, Server, wait_for};

use super::{KnownGroup, assert_complete, assert_refused, assert_withheld, create_run, critique, replay};
use crate::design;
use crate::openenv::socket::OpenEnvSocket;

/// Runs one episode of group `g` in a session, in which the agent holds. Returns the id of the episode.
async fn hold_in_session(api: &ApiClient) -> String {
    let mut socket = OpenEnvSocket::connect(api, "/ws").await;
    let _ = socket.reset(json!({"run": "run", "group_id": "g"})).await;
    while socket.step(json!({"burns": []})).await["done"] != true {}
    let reported = socket.state().await["reported"].clone();
    assert_eq!(reported["status"], "counted", "{reported}");
    reported["episode"].as_str().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn stepped_sessions_have_the_same_rule() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 2})).await;
    let _ = api.lease("run", json!({"groups": 1})).await; // waits until scenarios are prepared
    let first = hold_in_session(&api).await;
    assert_refused(&replay(&api, "run", &first, "reference").await, 409, "scenario_in_use", "open group");
    assert_withheld(&critique(&api, "run", &first).await, "open group");
    let _ = hold_in_session(&api).await;
    let _ = replay(&api, "run", &first, "reference").await.expect(200);
    assert!(critique(&api, "run", &first).await["withheld"].is_null());
}

/// Waits until the run has an active layout, and leases groups of layouts.
async fn lease_designed_groups(api: &ApiClient) -> Lease {
    wait_for("a layout is in stock", async || {
        let listed = api.get("/v1/layouts?state=active").await.expect(200);
        (!listed["designs"].as_array().unwrap().is_empty()).then_some(())
    })
    .await;
    api.lease("run", json!({"groups": 16})).await
}

#[tokio::test]
async fn layout_pages_and_checks_of_layouts_disclose_no_plan() {
    let server = Server::start().await;
    let api = server.api();
    design::create(&api, json!({"share": 1.0, "fixed_share": true, "layout_share": 1.0, "reserve": 4})).await;
    design::report_losses(&api).await;
    let lease = lease_designed_groups(&api).await;
    let group = KnownGroup::find(&lease);
    let mut listed = lease.0["groups"].as_array().unwrap().iter();
    let listed = listed.find(|listed| listed["episodes"][0] == json!(group.episodes[0])).unwrap();
    let layout = listed["layout"].as_str().expect("a designed group");
    group.report(&api, "run", 0..1).await;
    let first = &group.episodes[0];
    assert_refused(&replay(&api, "run", first, "reference").await, 409, "scenario_in_use", "open group");
    assert_withheld(&critique(&api, "run", first).await, "open group");
    let published = api.get(&format!("/v1/layouts/{layout}")).await.expect(200);
    assert_eq!(Scenario::from_json(&published["scenario"]).unwrap(), group.scenario);
    for page in [&published, &api.get(&format!("/v1/runs/run/designs/{layout}")).await.expect(200)] {
        let text = page.to_string();
        assert!(["actions", "plan\"", "avoidance"].iter().all(|word| !text.contains(word)), "{text}");
    }
    // A layout is a scenario with a user seed, so a client can check it.
    let request = json!({"scenario": published["scenario"], "actions": {"steps": [], "stopped": "too_late"}});
    let checked = api.post("/v1/scenarios", request.clone()).await.expect(200);
    assert_withheld(&checked["critique"], "open group");
    // The lease has several groups of the layout: all of them must be closed.
    group.report(&api, "run", 1..2).await;
    assert_refused(&replay(&api, "run", first, "reference").await, 409, "scenario_in_use", "open group");
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", lease.id()), json!({})).await.expect(200);
    let _ = replay(&api, "run", first, "reference").await.expect(200);
    assert_complete(&api.post("/v1/scenarios", request).await.expect(200)["critique"]);
}

#[tokio::test]
async fn plans_of_evaluation_scenarios_are_never_disclosed() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 1})).await;
    let request = json!({"policy": "mine", "run": "run", "rollouts": 1, "stochastic": false, "tasks": ["kessler/survival"]});
    let evaluation = api.post("/v1/evaluations", request).await.expect(201)["id"].clone();
    let request = json!({"groups": 24, "purpose": "eval", "evaluation": evaluation});
    for request in [request, json!({"groups": 24, "purpose": "eval"})] {
        let group = KnownGroup::find(&api.lease("run", request).await);
        let results = group.results(0..1);
        let response = api.report("run", results).await;
        assert_ne!(response["results"][0]["status"], "refused", "{response}");
        let episode = &group.episodes[0];
        let refused = replay(&api, "run", episode, "reference").await;
        assert_refused(&refused, 403, "evaluation_scenario", "an evaluation scenario");
        assert_withheld(&critique(&api, "run", episode).await, "an evaluation scenario");
        let _ = replay(&api, "run", episode, "agent").await.expect(200);
    }
}
