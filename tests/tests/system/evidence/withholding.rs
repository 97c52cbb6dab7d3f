//! Trainers that report the groups they win and keep the others leased.

use serde_json::{Value, json};
use system_tests::wait_until;

use super::{EvidenceServer, create_run, hold_results, task};

/// A policy that only holds reports what it wins, and keeps the rest leased for a day.
#[tokio::test(flavor = "multi_thread")]
async fn withheld_groups_move_no_level_and_inflate_no_mastery() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({"contested_share": 0.5})).await;
    for _ in 0..4 {
        let lease = api.lease("run", json!({"groups": 256, "ttl_s": 86_400})).await;
        let won: Vec<Value> =
            hold_results(&lease).into_iter().filter(|(_, won)| *won).map(|(result, _)| result).collect();
        assert!(!won.is_empty(), "some scenarios need no action");
        let report = api.report("run", won).await;
        assert_eq!(report["moves"], json!([]), "{report}");
    }
    let task = task(&api, "run").await;
    assert_eq!(task["level"], 0);
    let shown = &task["mastery"];
    assert!(shown["mean"].as_f64().unwrap() <= 0.5, "{shown}");
    assert!(shown["open"].as_u64().unwrap() > 100, "{shown}");
}

/// The same under automatic domain randomisation, which has bounds instead of levels.
#[tokio::test(flavor = "multi_thread")]
async fn withheld_groups_widen_no_bound() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({"strategy": "adr"})).await;
    for _ in 0..3 {
        let lease = api.lease("run", json!({"groups": 128, "ttl_s": 86_400})).await;
        let won = hold_results(&lease).into_iter().filter(|(_, won)| *won).map(|(result, _)| result);
        api.report("run", won.collect()).await;
    }
    let task = task(&api, "run").await;
    for estimate in task["levels"].as_array().unwrap() {
        assert!(estimate["mean"].as_f64().unwrap() <= 0.5, "{estimate}");
    }
    let state = api.get("/v1/runs/run/mastery").await.expect(200)["explanation"]["tasks"][0].clone();
    let state = state["current_state"].as_str().unwrap();
    assert!(state.contains("(0 moves"), "{state}");
}

/// A trainer that renews for ever holds the others back until its first lifetime is over and 64 later results wait.
#[tokio::test(flavor = "multi_thread")]
async fn renewed_group_is_missing_once_later_results_wait() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let withheld = api.lease("run", json!({"groups": 1, "ttl_s": 6})).await;
    let renew = format!("/v1/runs/run/leases/{}/renew", withheld.id());
    let started = std::time::Instant::now();
    while started.elapsed() < std::time::Duration::from_millis(6500) {
        let _ = api.post(&renew, json!({})).await.expect(200);
        tokio::time::sleep(std::time::Duration::from_millis(300)).await;
    }
    let later = api.lease("run", json!({"groups": 80})).await;
    let results: Vec<Value> = hold_results(&later).into_iter().map(|(result, _)| result).collect();
    let _ = api.post(&renew, json!({})).await.expect(200);
    let (first, second) = results.split_at(40);
    api.report("run", first.to_vec()).await;
    let waiting = task(&api, "run").await;
    assert_eq!(waiting["mastery"]["n"], 0, "40 results wait: {waiting}");
    assert!(waiting["held_back"].as_str().unwrap().contains("results wait for"), "{waiting}");
    api.report("run", second.to_vec()).await;
    let task = task(&api, "run").await;
    let shown = &task["mastery"];
    assert_eq!(shown["n"], 64, "{shown}");
    assert_eq!(shown["seen"], 81, "the withheld group is one of them: {shown}");
    // The result of the withheld group arrives too late.
    let (result, _) = hold_results(&withheld).remove(0);
    let report = api.report("run", vec![result]).await;
    assert_eq!(report["results"][0]["status"], "late", "{report}");
}

/// The same without a later report: the server looks at renewed leases once a second.
#[tokio::test(flavor = "multi_thread")]
async fn renewed_group_is_missing_by_the_clock() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let withheld = api.lease("run", json!({"groups": 1, "ttl_s": 20})).await;
    let later = api.lease("run", json!({"groups": 80})).await;
    api.report("run", hold_results(&later).into_iter().map(|(result, _)| result).collect()).await;
    let waiting = task(&api, "run").await;
    assert_eq!(waiting["mastery"]["n"], 0, "the lease is younger than its first lifetime: {waiting}");
    // The renewed deadline is later than the first one, at which the group is missing.
    let renew = format!("/v1/runs/run/leases/{}/renew", withheld.id());
    wait_until("the withheld group is missing", async || {
        let _ = api.post(&renew, json!({})).await;
        task(&api, "run").await["mastery"]["seen"] == 81
    })
    .await;
}
