//! Every route answers for a deleted run as for one that never was, before and after its rows are gone.

use orchestrator::service::{Config, Service};
use serde_json::{Value, json};
use system_tests::{ApiClient, ApiResponse, Server};

use super::populate::{PopulatedRun, create_populated_run};
use super::{archive, create, delete, is_unknown_run};

/// Returns a valid body for an operation with one.
fn body(operation: &str, ids: &PopulatedRun) -> Value {
    match operation {
        "acknowledge_trajectories" => json!({"ids": [1]}),
        "begin_groups" => json!({"groups": [0]}),
        "claim_trajectories" => json!({}),
        "claim_columns" => json!({"score": vec![0.5; 8]}),
        "create_lease" => json!({"groups": 1}),
        "log_trainer_metrics" => json!({"step": 1, "metrics": {"loss": 0.5}}),
        "report_results" => json!({"results": [{"episode": ids.episode, "failed": "lost"}]}),
        "set_members" => json!({"members": []}),
        "set_policy" => json!({"policy": "hold"}),
        "set_policy_version" => json!({"policy_version": 3}),
        "set_note" => json!({"note": ""}),
        "set_tags" => json!({"tags": []}),
        _ => json!({}),
    }
}

/// Returns the query that an operation requires.
pub(crate) fn query(operation: &str) -> &'static str {
    match operation {
        "delete_run" => "?name=the%20run%20gone",
        "list_failures" => "?task=kessler/survival",
        _ => "",
    }
}

/// Fills a path pattern with the ids of the run that is or was populated.
pub(crate) fn path(pattern: &str, ids: &PopulatedRun) -> String {
    let lease = if pattern.contains("columns") { &ids.columns } else { &ids.lease };
    [
        ("{run}", "gone"),
        ("{lease}", lease),
        ("{episode}", &ids.episode),
        ("{request}", &ids.design_request),
        ("{design}", &ids.layout),
        ("{version}", "1"),
    ]
    .iter()
    .fold(pattern.to_owned(), |path, (name, id)| path.replace(name, id))
}

/// Sends each operation with a run in its path, as the OpenAPI document lists them.
async fn assert_operations_find_no_run(api: &ApiClient, ids: &PopulatedRun) {
    let document = serde_json::to_value(orchestrator::http::openapi()).unwrap();
    let mut checked = 0;
    for (pattern, operations) in document["paths"].as_object().unwrap() {
        if !pattern.contains("{run}") {
            continue;
        }
        for (method, operation) in operations.as_object().unwrap() {
            let Some(name) = operation["operationId"].as_str() else { continue };
            let path = format!("{}{}", path(pattern, ids), query(name));
            assert!(!path.contains('{'), "{path}");
            let body = if operation["requestBody"].is_object() {
                body(name, ids).to_string()
            } else {
                String::new()
            };
            let response = api.request(&method.to_uppercase(), &path, "application/json", body).await;
            assert!(is_unknown_run(&response), "{name}: {response:?}");
            checked += 1;
        }
    }
    assert!(checked > 35, "{checked} operations");
}

/// Returns the values of a field of a list.
async fn listed(api: &ApiClient, path: &str, items: &str, field: &str) -> Vec<String> {
    let page = api.get(path).await.expect(200);
    page[items]
        .as_array()
        .unwrap()
        .iter()
        .map(|item| item[field].as_str().unwrap_or_default().to_owned())
        .collect()
}

async fn assert_lists_skip_the_run(api: &ApiClient, ids: &PopulatedRun) {
    for query in ["", "?archived=true", "?archived=true&tag=first", "?tag=first"] {
        assert!(!listed(api, &format!("/v1/runs{query}"), "runs", "id").await.contains(&"gone".to_owned()));
    }
    assert_eq!(listed(api, "/v1/evaluations", "evaluations", "run").await, [""; 0]);
    assert_eq!(listed(api, "/v1/layouts", "designs", "run").await, [""; 0]);
    let has_type = |response: &ApiResponse, kind: &str| {
        assert_eq!(
            (response.status, &response.body["type"]),
            (404, &json!(format!("urn:sparring:problem:{kind}")))
        );
    };
    has_type(&api.get(&format!("/v1/layouts/{}", ids.layout)).await, "unknown_layout");
    let evaluation = format!("/v1/evaluations/{}", ids.evaluation);
    for path in [&evaluation, &format!("{evaluation}/scenarios")] {
        has_type(&api.get(path).await, "unknown_evaluation");
    }
    has_type(&api.post(&format!("{evaluation}/cancel"), Value::Null).await, "unknown_evaluation");
    let compared = format!("/v1/evaluations/compare?a={0}&b={0}", ids.evaluation);
    has_type(&api.get(&compared).await, "unknown_evaluation");
    let new = json!({"policy": "mine", "run": "gone"});
    assert!(is_unknown_run(&api.post("/v1/evaluations", new).await));
    let metrics = api.get("/metrics").await;
    assert_eq!(metrics.status, 200);
}

/// Starts a service without workers on the database, so that the rows of a deleted run stay until the test deletes them.
async fn start_without_workers(server: &Server) -> (Service, ApiClient) {
    let config = Config::for_this_process(server.db_path());
    let token = config.process_token.as_ref().unwrap().expose().to_owned();
    let service = Service::start(config).await.unwrap();
    let api = ApiClient::new(&service.url()).with_token(&token);
    (service, api)
}

#[tokio::test(flavor = "multi_thread")]
async fn no_route_finds_a_deleted_run() {
    let mut server = Server::start().await;
    let ids = create_populated_run(&server.api(), "gone").await;
    create(&server.api(), "kept", json!({"tags": ["first"]})).await;
    archive(&server.api(), "gone").await;
    server.stop().await;

    let (service, api) = start_without_workers(&server).await;
    let _ = delete(&api, "gone", "?name=the%20run%20gone").await.expect(200);
    assert_operations_find_no_run(&api, &ids).await;
    assert_lists_skip_the_run(&api, &ids).await;
    let taken = api.post("/v1/runs", json!({"strategy": "ladder", "id": "gone"})).await.expect(409);
    assert_eq!(
        (&taken["type"], &taken["field"]),
        (&json!("urn:sparring:problem:run_being_deleted"), &json!("id"))
    );
    service.finish_deletions().await.unwrap();
    assert_operations_find_no_run(&api, &ids).await;
    assert_lists_skip_the_run(&api, &ids).await;
    assert_eq!(listed(&api, "/v1/runs?tag=first", "runs", "id").await, ["kept"]);
    service.stop().await;
}

/// Workers skip a deleted run, and its active leases are no leases any more.
#[tokio::test(flavor = "multi_thread")]
async fn workers_continue_for_other_runs() {
    let mut server = Server::start().await;
    let ids = create_populated_run(&server.api(), "gone").await;
    archive(&server.api(), "gone").await;
    server.stop().await;
    let (service, api) = start_without_workers(&server).await;
    let _ = delete(&api, "gone", "?name=the%20run%20gone").await.expect(200);
    service.stop().await;

    server.restart().await;
    let api = server.api();
    create(&api, "kept", json!({})).await;
    let lease = api.lease("kept", json!({"groups": 4})).await;
    api.report("kept", lease.results("hold")).await;
    let policy = json!({"policy": "hold", "max_unacknowledged_groups": 1});
    let _ = api.send_json("PUT", "/v1/runs/kept/policy", policy).await.expect(200);
    system_tests::wait_until("workers work", async || {
        let run = api.get("/v1/runs/kept").await.expect(200);
        let policy = api.get("/v1/runs/kept/policy").await.expect(200);
        run["critique_backlog"]["waiting"] == 0 && policy["feed"]["full"] == true
    })
    .await;
    super::create_again(&api, "gone").await;
    let late = json!({"results": [{"episode": ids.episode, "failed": "lost"}]});
    let late = api.post("/v1/runs/gone/results", late).await.expect(200);
    assert_eq!(late["results"][0]["status"], "refused", "{late}");
}
