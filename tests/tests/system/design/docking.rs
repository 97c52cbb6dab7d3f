//! A run on docking gets layouts for its failures, and leases serve them.

use serde_json::{Value, json};
use system_tests::Server;

use super::{wait_for_critiques, wait_for_response};

#[tokio::test]
async fn docking_run_serves_layouts_for_its_failures() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({
        "id": "run", "seed": 3, "strategy": "ladder", "group_size": 2, "placement": false, "tasks": ["docking/single"],
        "design": {"designer": "procedural", "share": 1.0, "fixed_share": true, "layout_share": 1.0, "reserve": 4}
    });
    let _ = api.post("/v1/runs", settings).await.expect(201);
    // An agent that never acts runs out of time.
    let lease = api.lease("run", json!({"groups": 24})).await;
    api.report("run", lease.results("hold")).await;
    let profile = wait_for_critiques(&api).await;
    let modes = profile["tasks"][0]["modes"].as_array().unwrap();
    let timeouts = modes.iter().find(|mode| mode["mode"] == "timeout").unwrap();
    assert_eq!(timeouts["count"], 48, "{profile}");
    let is_stocked = |summary: &Value| summary["tasks"][0]["active"].as_u64() >= Some(4);
    wait_for_response(&api, "/v1/runs/run/designs/statistics", is_stocked).await;

    let lease = api.lease("run", json!({"groups": 4})).await;
    for group in lease.0["groups"].as_array().unwrap() {
        let id = group["layout"].as_str().expect("every group is designed");
        let design = api.get(&format!("/v1/runs/run/designs/{id}")).await.expect(200);
        assert_eq!((&design["aim"]["mode"], &design["kind"]), (&json!("timeout"), &json!("threat")));
        let rows = design["design"]["deputies"].as_array().unwrap().len();
        assert_eq!((rows, design["table"]["rows"].as_array().unwrap().len()), (1, 1));
        assert_eq!(design["table"]["header"][1], "distance, m");
        let layout = api.get(&format!("/v1/layouts/{id}")).await.expect(200);
        let bodies = &layout["scenario"]["layout"]["bodies"]["deputies"];
        assert_eq!(bodies.as_array().map(Vec::len), Some(1));
        assert_eq!(lease.scenario(group).id().to_string(), group["scenario"].as_str().unwrap());
    }
    let report = api.report("run", lease.results("hold")).await;
    let receipts = report["results"].as_array().unwrap();
    assert!(receipts.iter().all(|receipt| receipt["status"] == "stored"), "{report}");
}
