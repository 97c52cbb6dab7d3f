//! A run on tasking gets layouts for its failures, and leases serve them.

use serde_json::{Value, json};
use system_tests::Server;

use super::{wait_for_critiques, wait_for_response};

/// A level with a small battery and short episodes.
fn small_battery() -> Value {
    let columns = json!(["battery_wh", "charge_max", "panel_m2", "time_limit_s"]);
    json!({"levels": {"columns": columns, "rows": [[40, 0.4, 0.5, 8700]]}})
}

#[tokio::test]
async fn tasking_run_serves_layouts_for_its_failures() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({
        "id": "run", "seed": 3, "group_size": 2, "placement": false, "strategy": "uniform",
        "tasks": ["tasking/scanning"],
        "task_settings": {"tasking/scanning": small_battery()},
        "design": {"designer": "procedural", "share": 1.0, "fixed_share": true, "layout_share": 1.0, "reserve": 2}
    });
    let _ = api.post("/v1/runs", settings).await.expect(201);
    // A satellite that drifts does not charge on purpose: its battery is empty in the shadow.
    let lease = api.lease("run", json!({"groups": 8})).await;
    api.report("run", lease.results("hold")).await;
    let profile = wait_for_critiques(&api).await;
    assert_eq!(profile["tasks"][0]["modes"][0]["mode"], "power", "{profile}");
    let request = json!({"task": "tasking/scanning", "count": 2});
    let _ = api.post("/v1/runs/run/designs", request).await.expect(202);
    let is_stocked = |summary: &Value| summary["tasks"][0]["active"].as_u64() >= Some(2);
    wait_for_response(&api, "/v1/runs/run/designs/statistics", is_stocked).await;

    let lease = api.lease("run", json!({"groups": 4})).await;
    for group in lease.0["groups"].as_array().unwrap() {
        let id = group["layout"].as_str().expect("every group is designed");
        let design = api.get(&format!("/v1/runs/run/designs/{id}")).await.expect(200);
        assert_eq!((&design["aim"]["mode"], &design["kind"]), (&json!("power"), &json!("threat")));
        let layout = api.get(&format!("/v1/layouts/{id}")).await.expect(200);
        let charge = layout["scenario"]["layout"]["bodies"]["satellites"][0][2].as_f64().unwrap();
        let percent = design["design"]["start"]["battery_percent"].as_f64().unwrap();
        assert!((100.0 * charge - percent).abs() < 1e-9, "{charge} {percent}");
        assert_eq!(lease.scenario(group).id().to_string(), group["scenario"].as_str().unwrap());
    }
    // Results on layouts are no evidence of mastery.
    let report = api.report("run", lease.results("hold")).await;
    let receipts = report["results"].as_array().unwrap();
    assert!(receipts.iter().all(|receipt| receipt["status"] == "stored"), "{report}");
}
