//! Deletion of runs: who may delete, what a deleted run answers, and that no row of it stays. This file has the helpers of these
//! tests.

mod archived;
mod clients;
mod kill;
pub(crate) mod populate;
pub(crate) mod routes;
pub(crate) mod rows;
mod rules;

use serde_json::{Value, json};
use system_tests::{ApiClient, ApiResponse, wait_until};

const TASK: &str = "kessler/survival";

/// Creates a run of one task whose scenarios are quick to prepare; `overrides` replaces settings.
async fn create(api: &ApiClient, id: &str, overrides: Value) {
    let mut request = json!({
        "strategy": "ladder", "id": id, "name": format!("the run {id}"), "seed": 5, "group_size": 2, "tasks": [TASK], "contested_share": 0.0,
        "placement": false, "design": {"designer": "off"},
    });
    request.as_object_mut().unwrap().extend(overrides.as_object().unwrap().clone());
    let _ = api.post("/v1/runs", request).await.expect(201);
}

async fn archive(api: &ApiClient, id: &str) {
    let _ = api.post(&format!("/v1/runs/{id}/archive"), Value::Null).await.expect(200);
}

/// Sends the request that deletes a run.
async fn delete(api: &ApiClient, id: &str, query: &str) -> ApiResponse {
    api.request("DELETE", &format!("/v1/runs/{id}{query}"), "application/json", "").await
}

/// Archives and deletes a run.
async fn archive_and_delete(api: &ApiClient, id: &str) {
    archive(api, id).await;
    let _ = delete(api, id, &format!("?name=the%20run%20{id}")).await.expect(200);
}

/// Waits until the id of a deleted run can be used again, and creates a run with it.
async fn create_again(api: &ApiClient, id: &str) {
    wait_until("the deletion is complete", async || {
        let request = json!({"strategy": "ladder", "id": id, "name": format!("the run {id}"), "tasks": [TASK], "design": {"designer": "off"}});
        let response = api.post("/v1/runs", request).await;
        assert!(response.status == 201 || response.body["type"] == "urn:sparring:problem:run_being_deleted", "{response:?}");
        response.status == 201
    })
    .await;
}

/// Returns true if a problem says that there is no such run.
fn is_unknown_run(response: &ApiResponse) -> bool {
    response.status == 404 && response.body["type"] == "urn:sparring:problem:unknown_run"
}
