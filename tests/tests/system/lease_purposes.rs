//! Results that are stored without counting: evaluation, stale policy versions, and training where probes are the evidence.

use serde_json::json;
use system_tests::Server;

use crate::leases::{create_run, statuses};

#[tokio::test]
async fn evaluation_and_stale_results_are_only_stored() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"seed": 9, "tasks": ["kessler/survival"], "max_staleness": 2});
    let id = create_run(&api, settings).await;
    let lease = api.lease(&id, json!({"groups": 4, "purpose": "eval"})).await;
    for group in lease.0["groups"].as_array().unwrap() {
        assert_eq!(group["seed"].as_u64().unwrap() >> 51, 0b10, "evaluation seeds");
    }
    assert_eq!(statuses(&api.report(&id, lease.results("hold")).await), ["stored"; 4]);
    let mastery = api.get(&format!("/v1/runs/{id}/mastery")).await.expect(200);
    assert_eq!(mastery["tasks"][0]["results"]["episodes"], 0);

    let lease = api.lease(&id, json!({"groups": 4, "policy_version": 5})).await;
    for group in lease.0["groups"].as_array().unwrap() {
        assert_eq!(group["seed"].as_u64().unwrap() >> 51, 0b01, "training seeds");
    }
    let results = lease.results("hold");
    let path = format!("/v1/runs/{id}/results");
    let fresh = api.post(&path, json!({"policy_version": 9, "results": [results[0]]})).await.expect(200);
    assert_eq!(statuses(&fresh), ["counted"]);
    let stale = api.post(&path, json!({"policy_version": 6, "results": [results[1]]})).await.expect(200);
    assert_eq!(statuses(&stale), ["stored"]);
    let near = api.post(&path, json!({"policy_version": 7, "results": [results[2]]})).await.expect(200);
    assert_eq!(statuses(&near), ["counted"]);
}

#[tokio::test]
async fn policy_version_can_be_set_back() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"seed": 9, "tasks": ["kessler/survival"], "max_staleness": 2});
    let id = create_run(&api, settings).await;
    let lease = api.lease(&id, json!({"groups": 3, "policy_version": 5})).await;
    let (results, path) = (lease.results("hold"), format!("/v1/runs/{id}/results"));
    let absurd = json!({"policy_version": 4_000_000_000_u32, "results": [results[0]]});
    assert_eq!(api.post(&path, absurd).await.expect(422)["field"], "policy_version");
    let wrong = json!({"policy_version": 400_000, "results": [results[0]]});
    assert_eq!(statuses(&api.post(&path, wrong).await.expect(200)), ["counted"]);
    assert_eq!(statuses(&api.post(&path, json!({"results": [results[1]]})).await.expect(200)), ["stored"]);

    let newest = format!("/v1/runs/{id}/policy_version");
    let set = api.request("PUT", &newest, "application/json", json!({"policy_version": 5}).to_string()).await;
    assert_eq!((set.status, &set.body["policy_version"]), (200, &json!(5)));
    assert_eq!(statuses(&api.post(&path, json!({"results": [results[2]]})).await.expect(200)), ["counted"]);
    for (settings, field) in
        [(json!({}), "policy_version"), (json!({"policy_version": -1}), "policy_version")]
    {
        let refused = api.request("PUT", &newest, "application/json", settings.to_string()).await;
        assert_eq!((refused.status, &refused.body["field"]), (422, &json!(field)));
    }
    let nowhere = "/v1/runs/nowhere/policy_version";
    let unknown =
        api.request("PUT", nowhere, "application/json", json!({"policy_version": 5}).to_string()).await;
    assert_eq!(unknown.status, 404);
}

#[tokio::test]
async fn training_is_no_evidence_if_probes_are() {
    let server = Server::start().await;
    let api = server.api();
    let id =
        create_run(&api, json!({"seed": 2, "evidence_from": "probe", "tasks": ["kessler/survival"]})).await;
    let train = api.lease(&id, json!({"groups": 2})).await;
    assert_eq!(statuses(&api.report(&id, train.results("hold")).await), ["stored"; 2]);
    let probe = api.lease(&id, json!({"groups": 2, "purpose": "probe"})).await;
    assert_eq!(statuses(&api.report(&id, probe.results("hold")).await), ["counted"; 2]);
}
