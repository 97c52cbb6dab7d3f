//! Time and settings: deadlines stand still while a run is paused, and a change of the rules drops the evidence before it.

use serde_json::{Value, json};

use super::{EvidenceServer, create_run, hold_results, task};

#[tokio::test(flavor = "multi_thread")]
async fn deadlines_stand_still_while_a_run_is_paused() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let lease = api.lease("run", json!({"groups": 4, "ttl_s": 5})).await;
    let path = format!("/v1/runs/run/leases/{}", lease.id());
    let _ = api.post("/v1/runs/run/pause", json!({})).await.expect(200);
    tokio::time::sleep(std::time::Duration::from_millis(6000)).await;
    let results: Vec<Value> = hold_results(&lease).into_iter().map(|(result, _)| result).collect();
    let report = api.report("run", results[..2].to_vec()).await;
    assert_eq!(report["results"][0]["status"], "counted", "the lease is not over: {report}");
    let _ = api.post("/v1/runs/run/resume", json!({})).await.expect(200);
    assert_eq!(api.get(&path).await.expect(200)["status"], "active");
    let report = api.report("run", results[2..].to_vec()).await;
    assert_eq!(report["results"][1]["status"], "counted", "{report}");
    // The deadline comes all the same.
    let short = api.lease("run", json!({"groups": 1, "ttl_s": 1})).await;
    let path = format!("/v1/runs/run/leases/{}", short.id());
    let expired = async || (api.get(&path).await.expect(200)["status"] == "expired").then_some(());
    system_tests::wait_for("the lease expires", expired).await;
}

/// Results under two rules of success must not be mixed, whether a slot was settled or open.
#[tokio::test(flavor = "multi_thread")]
async fn change_of_the_rules_drops_the_evidence_before_it() {
    let server = EvidenceServer::start();
    let api = server.api();
    for (run, first, change) in [
        (
            "threshold",
            json!({"success": "raw"}),
            json!({"task_settings": {"kessler/survival": {"success_threshold": 0.5}}}),
        ),
        ("purpose", json!({}), json!({"evidence_from": "probe"})),
        ("staleness", json!({}), json!({"max_staleness": 3})),
    ] {
        create_run(&api, run, first).await;
        let lease = api.lease(run, json!({"groups": 40})).await;
        let results: Vec<Value> = hold_results(&lease).into_iter().map(|(result, _)| result).collect();
        api.report(run, results[..36].to_vec()).await;
        let before = task(&api, run).await;
        assert_eq!((&before["status"]["blocks"], &before["mastery"]["n"]), (&json!(1), &json!(36)));
        let _ = api.send_json("PATCH", &format!("/v1/runs/{run}"), change).await.expect(200);
        let after = task(&api, run).await;
        assert_eq!((&after["level"], &after["status"]["blocks"]), (&json!(0), &json!(0)), "{run}: {after}");
        assert_eq!(after["status"]["epoch"], before["status"]["epoch"].as_u64().unwrap() + 1);
        api.report(run, results[36..].to_vec()).await;
        assert_eq!(task(&api, run).await["mastery"]["n"], 0, "{run}: the open slots are dropped");
    }
}
