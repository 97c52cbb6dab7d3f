//! Two runs with one seed: the one shows the scenarios of the other, so that groups count before they are begun.

use serde_json::{Value, json};
use system_tests::{ApiClient, Lease};

use super::{EvidenceServer, create_run, task};

/// Leases eight groups of a run that are not disclosed.
async fn lease(api: &ApiClient, run: &str) -> Lease {
    api.lease(run, json!({"groups": 8, "disclosure": "begin"})).await
}

/// Begins and reports the groups that `hold` wins, and returns the others.
async fn begin_easy_groups(api: &ApiClient, run: &str, lease: &Lease, easy: &[i64]) -> Value {
    let path = format!("/v1/runs/{run}/leases/{}", lease.id());
    let begun = Lease(api.post(&format!("{path}/groups/begin"), json!({"groups": easy})).await.expect(200));
    let _ = api.report(run, begun.results("hold")).await;
    let _ = api.post(&format!("{path}/release"), json!({})).await.expect(200);
    task(api, run).await["mastery"].clone()
}

/// The numbers of the groups that `hold` wins, as another run with the same seed shows them.
async fn groups_that_hold_wins(api: &ApiClient, run: &str) -> Vec<i64> {
    let shown = api.lease(run, json!({"groups": 8})).await;
    let wins = |group: &&Value| group["bracket"]["hold"].as_f64().unwrap() > 0.99;
    let groups = shown.0["groups"].as_array().unwrap();
    groups.iter().filter(wins).map(|group| group["group"].as_i64().unwrap()).collect()
}

/// A trainer looks at the scenarios in a first run and begins only the easy groups in a second one.
#[tokio::test(flavor = "multi_thread")]
async fn later_twin_cannot_return_groups_that_the_first_run_shows() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "first", json!({})).await;
    let easy = groups_that_hold_wins(&api, "first").await;
    assert!((1..8).contains(&easy.len()), "{easy:?}");
    create_run(&api, "second", json!({})).await;
    let leased = lease(&api, "second").await;
    assert_eq!(task(&api, "second").await["mastery"]["open"], 8, "every group is a slot");
    let shown = begin_easy_groups(&api, "second", &leased, &easy).await;
    let missing = (8 - easy.len()) as f64 / 8.0;
    assert_eq!((&shown["n"], &shown["missing"]), (&json!(8), &json!(missing)), "{shown}");
}

/// The trainer leases first, and creates the twin that shows the scenarios afterwards.
#[tokio::test(flavor = "multi_thread")]
async fn twin_that_is_created_later_makes_leased_groups_count() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "first", json!({})).await;
    let leased = lease(&api, "first").await;
    assert_eq!(task(&api, "first").await["mastery"]["open"], 0, "no group is a slot before it is begun");
    create_run(&api, "second", json!({})).await;
    assert_eq!(api.get("/v1/runs/first").await.expect(200)["seed_reused"], true);
    assert_eq!(task(&api, "first").await["mastery"]["open"], 8);
    let easy = groups_that_hold_wins(&api, "second").await;
    let shown = begin_easy_groups(&api, "first", &leased, &easy).await;
    let missing = (8 - easy.len()) as f64 / 8.0;
    assert_eq!((&shown["n"], &shown["missing"]), (&json!(8), &json!(missing)), "{shown}");
    // The returned scenarios are offered again for training. A second attempt is no slot.
    let again = lease(&api, "first").await;
    assert!(task(&api, "first").await["mastery"]["open"].as_u64().unwrap() <= easy.len() as u64, "{again:?}");
}

/// A run whose seed no other run has keeps the free return.
#[tokio::test(flavor = "multi_thread")]
async fn other_seed_changes_nothing() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "first", json!({})).await;
    create_run(&api, "second", json!({"seed": 2})).await;
    let leased = lease(&api, "second").await;
    let shown = begin_easy_groups(&api, "second", &leased, &[0]).await;
    assert_eq!((&shown["seen"], &shown["missing"]), (&json!(1), &json!(0.0)), "{shown}");
}
