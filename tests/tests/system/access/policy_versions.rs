//! The newest policy version of a run: its owner sets it, and no request raises it far above the newest one by mistake.

use serde_json::{Value, json};
use system_tests::{ApiClient, ApiResponse, TestSocket};

use super::{Parties, assert_denied};

async fn put_version(api: &ApiClient, version: u32) -> ApiResponse {
    api.send_json("PUT", "/v1/runs/run/policy_version", json!({"policy_version": version})).await
}

#[track_caller]
fn assert_invalid(response: ApiResponse, field: &str) {
    let body = response.expect(422);
    assert!(
        body["field"] == field
            && body["detail"].as_str().unwrap().contains("the newest version of the run is"),
        "{body}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn newest_version_is_set_by_the_owner_only() {
    let Parties { server: _server, owner, member, other, admin, .. } = Parties::start(json!({})).await;
    assert_denied(put_version(&other, 7).await, "not_run_owner");
    assert_denied(put_version(&member, 7).await, "not_run_owner");
    assert_denied(
        member.send_json("PUT", "/v1/runs/run/policy_versions/7", json!({})).await,
        "not_run_owner",
    );
    assert_eq!(put_version(&owner, 7).await.expect(200)["policy_version"], 7);
    assert_eq!(put_version(&owner, 1_000_007).await.expect(200)["policy_version"], 1_000_007);
    assert_invalid(put_version(&owner, 2_000_008).await, "policy_version");
    assert_invalid(put_version(&owner, u32::MAX).await, "policy_version");
    let description = owner.send_json("PUT", "/v1/runs/run/policy_versions/4294967295", json!({})).await;
    assert_invalid(description, "version");
    assert_eq!(put_version(&owner, 0).await.expect(200)["policy_version"], 0);
    assert_eq!(put_version(&admin, u32::MAX).await.expect(200)["policy_version"], u32::MAX);
}

#[tokio::test(flavor = "multi_thread")]
async fn leases_and_results_do_not_raise_the_version_by_far() {
    let Parties { server: _server, owner, member, .. } = Parties::start(json!({"max_staleness": 2})).await;
    let absurd = u32::MAX;
    for form in ["groups", "columns"] {
        let request = json!({"groups": 1, "form": form, "policy_version": absurd});
        assert_invalid(member.post("/v1/runs/run/leases", request).await, "policy_version");
    }
    let lease = member.lease("run", json!({"groups": 3})).await;
    let mut results = lease.results("hold");
    let batch = json!({"results": results, "policy_version": absurd});
    assert_invalid(member.post("/v1/runs/run/results", batch).await, "policy_version");
    results[0]["policy_version"] = json!(absurd);
    results[1]["policy_version"] = json!(4);
    let report = member.report("run", results).await;
    let receipts = report["results"].as_array().unwrap();
    assert_eq!((&receipts[0]["status"], &receipts[0]["code"]), (&json!("refused"), &json!("invalid_result")));
    assert!(
        receipts[0]["detail"].as_str().unwrap().starts_with("policy_version: must be at most"),
        "{report}"
    );
    assert_eq!(receipts[1]["status"], "counted");
    assert_eq!(owner.get("/v1/runs/run").await.expect(200)["policy_version"], 4);
    let columns = member.lease("run", json!({"groups": 1, "form": "columns"})).await;
    let claim = json!({"score": [0.0], "failed": [1], "steps": [1], "policy_version": absurd});
    let claim = member.post(&format!("/v1/runs/run/leases/{}/columns", columns.id()), claim).await;
    assert_invalid(claim, "policy_version");
    let policy = json!({"policy": "hold", "version": absurd});
    assert_invalid(owner.send_json("PUT", "/v1/runs/run/policy", policy).await, "version");
}

#[tokio::test(flavor = "multi_thread")]
async fn session_does_not_name_a_version_far_above() {
    let Parties { server: _server, member, .. } = Parties::start(json!({})).await;
    let lease = member.lease("run", json!({"groups": 1})).await;
    let requests: [Value; 2] = [json!({"run": "run"}), json!({"run": "run", "group_id": "g"})];
    let with_lease = json!({"run": "run", "lease_id": lease.id()});
    for mut open in requests.into_iter().chain([with_lease]) {
        let fields = json!({"type": "open", "version": 2, "policy_version": u32::MAX});
        open.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        let reply = TestSocket::connect(&member, "/v1/sessions").await.request(&open).await;
        assert_eq!(
            (&reply["code"], &reply["field"]),
            (&json!("invalid"), &json!("policy_version")),
            "{reply}"
        );
    }
}
