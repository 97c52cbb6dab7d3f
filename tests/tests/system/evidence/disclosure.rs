//! Leases that disclose their scenarios group by group.

use serde_json::{Value, json};
use system_tests::{ApiClient, Lease};

use super::{EvidenceServer, create_run, task};

async fn begin(api: &ApiClient, lease: &Lease, groups: &[i64]) -> Lease {
    let path = format!("/v1/runs/run/leases/{}/groups/begin", lease.id());
    Lease(api.post(&path, json!({"groups": groups})).await.expect(200))
}

async fn release(api: &ApiClient, lease: &Lease) {
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", lease.id()), json!({})).await.expect(200);
}

/// An honest trainer that returns two groups of eight without beginning them fills its blocks as if it had leased six.
#[tokio::test(flavor = "multi_thread")]
async fn groups_that_were_never_begun_return_without_loss() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    for _ in 0..12 {
        let lease = api.lease("run", json!({"groups": 8, "disclosure": "begin"})).await;
        assert_eq!(lease.0["groups"], json!([]), "no scenario is disclosed");
        assert_eq!(lease.0["recipes"], json!([]));
        assert_eq!(lease.0["undisclosed"].as_array().unwrap().len(), 8);
        let begun = begin(&api, &lease, &[0, 1, 2, 3, 4, 5]).await;
        assert_eq!(begun.0["groups"].as_array().unwrap().len(), 6);
        api.report("run", begun.results("hold")).await;
        release(&api, &lease).await;
    }
    let task = task(&api, "run").await;
    assert_eq!((&task["mastery"]["n"], &task["mastery"]["seen"]), (&json!(64), &json!(72)), "{task}");
    assert_eq!((&task["mastery"]["missing"], &task["status"]["blocks"]), (&json!(0.0), &json!(2)), "{task}");
    assert_eq!(task["results"]["expired"], 0);
}

/// With `disclosure: lease` blocks fill all the same, the worst case decides, and the run says so.
#[tokio::test(flavor = "multi_thread")]
async fn groups_that_were_disclosed_and_returned_are_missing() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    for _ in 0..8 {
        let lease = api.lease("run", json!({"groups": 8})).await;
        api.report("run", lease.results("hold").into_iter().take(6).collect()).await;
        release(&api, &lease).await;
    }
    let task = task(&api, "run").await;
    assert!(task["status"]["blocks"].as_u64().unwrap() >= 1, "{task}");
    assert!(task["mastery"]["missing"].as_f64().unwrap() > 0.1, "{task}");
    assert!(task["warnings"][0].as_str().unwrap().contains("are missing"), "{task}");
}

#[tokio::test(flavor = "multi_thread")]
async fn undisclosed_groups_are_hidden_and_accept_no_results() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let lease = api.lease("run", json!({"groups": 2, "disclosure": "begin"})).await;
    let episode = format!("ep_{}_1", lease.id());
    for path in ["", "/replay?plan=hold", "/critique"] {
        let answer = api.get(&format!("/v1/runs/run/episodes/{episode}{path}")).await;
        assert!(answer.status == 409 || answer.status == 404, "{path}: {}", answer.status);
    }
    let result = json!({"episode": episode, "status": "failed", "reason": "guessed"});
    let report = api.report("run", vec![result]).await;
    let receipt: &Value = &report["results"][0];
    assert_eq!((&receipt["status"], &receipt["code"]), (&json!("refused"), &json!("not_begun")), "{receipt}");
    // Beginning is idempotent, and shows the same scenario again.
    let first = begin(&api, &lease, &[1]).await;
    let again = begin(&api, &lease, &[1]).await;
    assert_eq!(first.0["groups"], again.0["groups"]);
    let shown = Lease(api.get(&format!("/v1/runs/run/leases/{}", lease.id())).await.expect(200));
    assert_eq!(shown.0["groups"].as_array().unwrap().len(), 1);
    assert_eq!(shown.0["undisclosed"][0]["group"], 0);
    let counted = api.report("run", shown.results("hold")).await;
    assert_eq!(counted["results"][0]["status"], "counted", "{counted}");
}

#[tokio::test(flavor = "multi_thread")]
async fn invalid_begins_say_how_to_fix_them() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let lease = api.lease("run", json!({"groups": 2})).await;
    let path = format!("/v1/runs/run/leases/{}/groups/begin", lease.id());
    let refused = api.post(&path, json!({"groups": [0]})).await.expect(422);
    assert!(refused["detail"].as_str().unwrap().contains("disclosure: begin"), "{refused}");
    for groups in [json!([]), json!([7]), json!([-1])] {
        let lease = api.lease("run", json!({"groups": 2, "disclosure": "begin"})).await;
        let path = format!("/v1/runs/run/leases/{}/groups/begin", lease.id());
        let refused = api.post(&path, json!({"groups": groups})).await.expect(422);
        assert_eq!(refused["field"], "groups", "{refused}");
    }
    for request in [
        json!({"groups": 2, "disclosure": "begin", "purpose": "eval"}),
        json!({"groups": 2, "disclosure": "begin", "form": "columns"}),
    ] {
        let refused = api.post("/v1/runs/run/leases", request).await.expect(422);
        assert_eq!(refused["field"], "disclosure", "{refused}");
    }
}
