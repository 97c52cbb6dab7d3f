//! Tags of runs: they are set at the creation or replaced later, and filter the list of runs.

use serde_json::{Value, json};
use system_tests::{ApiClient, Server};

const TASK: &str = "kessler/survival";

async fn create(api: &ApiClient, id: &str, tags: Value) -> Value {
    let request = json!({"id": id, "tasks": [TASK], "design": {"designer": "off"}, "tags": tags});
    api.post("/v1/runs", request).await.expect(201)
}

async fn put(api: &ApiClient, id: &str, tags: Value) -> system_tests::ApiResponse {
    api.send_json("PUT", &format!("/v1/runs/{id}/tags"), json!({ "tags": tags })).await
}

/// Returns the ids of a list of runs.
async fn listed(api: &ApiClient, query: &str) -> Vec<String> {
    let page = api.get(&format!("/v1/runs?{query}")).await.expect(200);
    page["runs"].as_array().unwrap().iter().map(|run| run["id"].as_str().unwrap().to_owned()).collect()
}

#[tokio::test]
async fn tags_are_set_replaced_and_kept() {
    let mut server = Server::start().await;
    let api = server.api();
    assert_eq!(create(&api, "plain", json!([])).await["tags"], json!([]));
    assert_eq!(
        create(&api, "a", json!(["paper", "lr:3e-4", "paper"])).await["tags"],
        json!(["lr:3e-4", "paper"])
    );
    let replaced = put(&api, "a", json!(["v1.2_b-c", "7"])).await.expect(200);
    assert_eq!((&replaced["id"], &replaced["tags"]), (&json!("a"), &json!(["7", "v1.2_b-c"])));
    let patched = api.send_json("PATCH", "/v1/runs/a", json!({"name": "renamed"})).await.expect(200);
    assert_eq!(patched["tags"], replaced["tags"]);
    server.restart().await;
    let api = server.api();
    assert_eq!(api.get("/v1/runs/a").await.expect(200)["tags"], replaced["tags"]);
    assert_eq!(put(&api, "a", json!([])).await.expect(200)["tags"], json!([]));
    assert_eq!(put(&api, "missing", json!([])).await.expect(404)["type"], "urn:sparring:problem:unknown_run");
    let audit = api.get("/v1/audit").await.expect(200);
    let operations: Vec<_> =
        audit["entries"].as_array().unwrap().iter().map(|entry| &entry["operation"]).collect();
    assert!(operations.contains(&&json!("PUT /v1/runs/{run}/tags")), "{audit}");
}

#[tokio::test]
async fn invalid_tags_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    let _ = create(&api, "a", json!(["kept"])).await;
    let many: Vec<String> = (0..33).map(|n| format!("t{n}")).collect();
    let mut problems = Vec::new();
    for tags in [
        json!(["ok", "Paper"]),
        json!([""]),
        json!(["-x"]),
        json!(["two words"]),
        json!(["x".repeat(65)]),
        json!([1]),
        json!("paper"),
        json!(many),
    ] {
        let problem = put(&api, "a", tags.clone()).await.expect(422);
        let request = json!({"id": "b", "tasks": [TASK], "tags": tags});
        assert_eq!(api.post("/v1/runs", request).await.expect(422)["field"], problem["field"]);
        problems.push(format!(
            "{}: {}",
            problem["field"].as_str().unwrap(),
            problem["detail"].as_str().unwrap()
        ));
    }
    insta::assert_snapshot!(problems.join("\n"));
    assert_eq!(api.get("/v1/runs/a").await.expect(200)["tags"], json!(["kept"]));
    assert_eq!(put(&api, "a", json!(many[..32])).await.expect(200)["tags"].as_array().unwrap().len(), 32);
    let unknown = api.send_json("PUT", "/v1/runs/a/tags", json!({"tags": [], "add": []})).await.expect(422);
    assert_eq!(unknown["field"], "add");
    assert_eq!(api.get("/v1/runs?tag=No").await.expect(422)["field"], "tag");
}

#[tokio::test]
async fn list_of_runs_is_filtered_by_tag() {
    let server = Server::start().await;
    let api = server.api();
    for n in 0..7 {
        let tags = if n % 2 == 0 { json!(["even", "all"]) } else { json!(["all"]) };
        let _ = create(&api, &format!("run-{n}"), tags).await;
    }
    assert_eq!(listed(&api, "tag=even").await, ["run-0", "run-2", "run-4", "run-6"]);
    assert_eq!(listed(&api, "tag=none").await, [""; 0]);
    let _ = api.post("/v1/runs/run-4/archive", Value::Null).await.expect(200);
    assert_eq!(listed(&api, "tag=even").await, ["run-0", "run-2", "run-6"]);
    assert_eq!(listed(&api, "tag=even&archived=true").await, ["run-4"]);
    // Pages of a filtered list are complete and in order.
    let (mut all, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = api.get(&format!("/v1/runs?tag=all&limit=2{cursor}")).await.expect(200);
        all.extend(page["runs"].as_array().unwrap().iter().map(|run| run["id"].as_str().unwrap().to_owned()));
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => break,
        }
    }
    assert_eq!(all, ["run-0", "run-1", "run-2", "run-3", "run-5", "run-6"]);
    let _ = put(&api, "run-0", json!(["all"])).await.expect(200);
    assert_eq!(listed(&api, "tag=even").await, ["run-2", "run-6"]);
}
