//! Plans of scenarios that several runs have, because the runs have the same seed.

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, episode_result, wait_until};

use super::{KnownGroup, assert_refused, create_run, replay};
use crate::feed::column_trainer::scenarios;

/// Leases 16 groups of a run, and reports all episodes of a group. Returns the group.
async fn report_group(api: &ApiClient, run: &str) -> KnownGroup {
    let group = KnownGroup::find(&api.lease(run, json!({"groups": 16})).await);
    group.report(api, run, 0..2).await;
    group
}

#[tokio::test]
async fn plan_is_withheld_while_another_run_uses_the_scenario() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "first", json!({})).await;
    let waiting = api.lease("first", json!({"groups": 16})).await;
    create_run(&api, "second", json!({})).await;
    let group = report_group(&api, "second").await;
    let same = KnownGroup::find(&waiting);
    assert_eq!(group.scenario, same.scenario, "runs with one seed have the same scenarios");
    let episode = &group.episodes[0];
    let refused = replay(&api, "second", episode, "reference").await;
    assert_refused(&refused, 409, "scenario_in_use", "Run first has an open group");
    // A released group returns to the queue.
    let _ = api.post(&format!("/v1/runs/first/leases/{}/release", waiting.id()), json!({})).await.expect(200);
    let refused = replay(&api, "second", episode, "reference").await;
    assert_refused(&refused, 409, "scenario_in_use", "Run first has this scenario in its queue");
    let again = report_group(&api, "first").await;
    assert_eq!(again.scenario, group.scenario);
    let _ = replay(&api, "second", episode, "reference").await.expect(200);
}

/// A paused run has proposals without scenarios.
#[tokio::test]
async fn plan_is_withheld_while_a_paused_run_will_use_the_scenario() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "paused", json!({})).await;
    let _ = api.post("/v1/runs/paused/pause", json!({})).await.expect(200);
    create_run(&api, "other", json!({})).await;
    let group = report_group(&api, "other").await;
    let episode = &group.episodes[0];
    let refused = replay(&api, "other", episode, "reference").await;
    assert_refused(&refused, 409, "scenario_in_use", "Run paused has this scenario in its queue");
    let _ = api.post("/v1/runs/paused/archive", json!({})).await.expect(200);
    let deleted = api.request("DELETE", "/v1/runs/paused?name=paused", "application/json", "").await;
    let _ = deleted.expect(200);
    let _ = replay(&api, "other", episode, "reference").await.expect(200);
}

#[tokio::test]
async fn plan_is_withheld_while_a_lease_of_columns_has_the_scenario() {
    let server = Server::start().await;
    let api = server.api();
    let plain = json!({"contested_share": 0.0, "group_size": 1});
    create_run(&api, "columns", plain.clone()).await;
    let columns = api.lease("columns", json!({"groups": 64, "form": "columns"})).await;
    create_run(&api, "groups", plain).await;
    // A lease of columns has proposals of its own, which follow those of the queue.
    let _ = api.lease("groups", json!({"groups": 64})).await;
    let groups = api.lease("groups", json!({"groups": 64})).await;
    let mut shared =
        groups.episodes().into_iter().filter(|(_, scenario)| scenarios(&columns).contains(scenario));
    let (episode, scenario) = shared.next().expect("the first seed of a range is that of a group");
    api.report("groups", vec![episode_result(&episode, &scenario, "hold")]).await;
    let refused = replay(&api, "groups", &episode, "reference").await;
    assert_refused(&refused, 409, "scenario_in_use", "Run columns has an open group");
    let _ =
        api.post(&format!("/v1/runs/columns/leases/{}/release", columns.id()), json!({})).await.expect(200);
    let _ = replay(&api, "groups", &episode, "reference").await.expect(200);
}

/// Reads the mark of a run.
async fn is_seed_reused(api: &ApiClient, run: &str) -> Value {
    api.get(&format!("/v1/runs/{run}")).await.expect(200)["seed_reused"].clone()
}

#[tokio::test]
async fn runs_with_a_used_seed_are_marked() {
    let server = Server::start().await;
    let api = server.api();
    assert_eq!(create_run(&api, "first", json!({"seed": 3})).await["seed_reused"], false);
    assert_eq!(create_run(&api, "other", json!({"seed": 4})).await["seed_reused"], false);
    assert_eq!(create_run(&api, "second", json!({"seed": 3})).await["seed_reused"], true);
    // A refused run uses no seed.
    let _ = api.post("/v1/runs", json!({"strategy": "ladder", "id": "first", "seed": 5})).await.expect(409);
    assert_eq!(create_run(&api, "third", json!({"seed": 5})).await["seed_reused"], false);
    assert_eq!(is_seed_reused(&api, "first").await, true, "the second run shows the scenarios of the first");
    assert_eq!(is_seed_reused(&api, "second").await, true);
    // The seed of a deleted run stays known.
    let _ = api.post("/v1/runs/other/archive", json!({})).await.expect(200);
    let deleted = api.request("DELETE", "/v1/runs/other?name=other", "application/json", "").await;
    let _ = deleted.expect(200);
    wait_until("the run is deleted", async || {
        api.post(
            "/v1/runs",
            json!({"strategy": "ladder", "id": "other", "seed": 6, "tasks": ["docking/single"]}),
        )
        .await
        .status
            == 201
    })
    .await;
    assert_eq!(create_run(&api, "fourth", json!({"seed": 4})).await["seed_reused"], true);
    let listed = api.get("/v1/runs").await.expect(200);
    let marks: Vec<&Value> =
        listed["runs"].as_array().unwrap().iter().map(|run| &run["seed_reused"]).collect();
    assert_eq!(json!(marks), json!([true, true, false, false, true]));
}
