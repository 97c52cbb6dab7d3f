//! Policy versions of a run.

use serde_json::json;
use system_tests::Server;

use super::SURVIVAL;

#[tokio::test(flavor = "multi_thread")]
async fn versions_have_metadata_results_and_staleness() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"id": "run", "seed": 4, "tasks": [SURVIVAL], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    for (version, policy) in [(1, "hold"), (2, "reference")] {
        let lease = api.lease("run", json!({"groups": 12, "policy_version": version})).await;
        let _ = api.report("run", lease.results(policy)).await;
    }
    let version_2 = json!({"checkpoint": "checkpoints/2", "notes": "the planner itself"});
    let version_2 = api.send_json("PUT", "/v1/runs/run/policy_versions/2", version_2).await.expect(200);
    assert_eq!(
        (&version_2["checkpoint"], &version_2["tasks"][0]["episodes"]),
        (&json!("checkpoints/2"), &json!(12))
    );
    let _ = api
        .send_json("PUT", "/v1/runs/run/policy_versions/5", json!({"checkpoint": "checkpoints/5"}))
        .await
        .expect(200);
    assert_eq!(
        api.get("/v1/runs/run").await.expect(200)["policy_version"],
        5,
        "the announced version is the newest"
    );
    let page = api.get("/v1/runs/run/policy_versions?limit=2").await.expect(200);
    let numbers = |page: &serde_json::Value| {
        page["versions"]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| (v["version"].as_u64().unwrap(), v["staleness"].as_u64().unwrap()))
            .collect::<Vec<_>>()
    };
    assert_eq!(numbers(&page), [(5, 0), (2, 3)]);
    let rest = api
        .get(&format!("/v1/runs/run/policy_versions?limit=2&cursor={}", page["next"].as_str().unwrap()))
        .await
        .expect(200);
    assert_eq!(numbers(&rest), [(1, 4)]);
    let (good, bad) = (&page["versions"][1]["tasks"][0], &rest["versions"][0]["tasks"][0]);
    assert!(good["success"].as_f64().unwrap() > bad["success"].as_f64().unwrap(), "{good} {bad}");
    assert!(
        rest["versions"][0]["described_at"].is_null()
            && page["versions"][0]["tasks"].as_array().unwrap().is_empty()
    );
    for (path, settings, status) in [
        ("/v1/runs/run/policy_versions/x", json!({}), 422),
        ("/v1/runs/run/policy_versions/-1", json!({}), 422),
        ("/v1/runs/unknown/policy_versions/1", json!({}), 404),
        ("/v1/runs/run/policy_versions/1", json!({"notes": "x".repeat(2001)}), 422),
        ("/v1/runs/run/policy_versions/1", json!({"weights": "x"}), 422),
    ] {
        let response = api.send_json("PUT", path, settings).await;
        assert!(
            response.status == status || (status == 422 && response.status == 400),
            "{path}: {}",
            response.status
        );
    }
}
