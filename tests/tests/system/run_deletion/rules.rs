//! Conditions of a deletion, and what stays.

use serde_json::{Value, json};
use system_tests::Server;

use super::{archive, archive_and_delete, create, create_again, delete, is_unknown_run};

#[tokio::test]
async fn only_archived_runs_are_deleted_by_name() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, "a", json!({"name": "100 % & more"})).await;
    assert!(is_unknown_run(&delete(&api, "missing", "?name=x").await));
    let name = "?name=100%20%25%20%26%20more";
    let problem = delete(&api, "a", name).await.expect(409);
    assert_eq!(problem["type"], "urn:sparring:problem:run_not_archived");
    assert!(problem["detail"].as_str().unwrap().contains("POST /v1/runs/a/archive"), "{problem}");
    archive(&api, "a").await;
    for query in ["", "?", "?name=x&name=y"] {
        assert_eq!(delete(&api, "a", query).await.expect(400)["field"], "name", "{query}");
    }
    for query in ["?name=", "?name=a", "?name=100%20%25"] {
        assert_eq!(delete(&api, "a", query).await.expect(409)["field"], "name", "{query}");
    }
    assert_eq!(delete(&api, "a", "?name=x&force=true").await.expect(400)["field"], "force");
    let _ = api.get("/v1/runs/a").await.expect(200);
    let deleted = delete(&api, "a", name).await.expect(200);
    assert_eq!((&deleted["id"], &deleted["name"]), (&json!("a"), &json!("100 % & more")));
    assert!(is_unknown_run(&api.get("/v1/runs/a").await));
    assert!(is_unknown_run(&delete(&api, "a", name).await));
    let audit = api.get("/v1/audit").await.expect(200);
    let entries = audit["entries"].as_array().unwrap();
    assert!(
        entries.iter().any(|entry| entry["operation"] == "DELETE /v1/runs/{run}" && entry["status"] == 200),
        "{audit}"
    );
}

#[tokio::test]
async fn later_run_with_the_same_id_starts_anew() {
    let mut server = Server::start().await;
    let api = server.api();
    create(&api, "again", json!({"tags": ["old"]})).await;
    let first = api.lease("again", json!({"groups": 3})).await;
    api.report("again", first.results("hold")).await;
    archive_and_delete(&api, "again").await;
    create_again(&api, "again").await;
    let run = api.get("/v1/runs/again").await.expect(200);
    assert_eq!(
        (&run["tags"], &run["archived_at"], &run["status"]),
        (&json!([]), &Value::Null, &json!("active"))
    );
    let overview = api.get("/v1/runs/again/overview").await.expect(200);
    assert_eq!((&overview["episodes"], &overview["leases"]), (&json!(0), &json!(0)));
    // The number of a lease is never used again, although its run was the only one.
    let number = |lease: &system_tests::Lease| lease.id().split_once('-').unwrap().0.parse::<i64>().unwrap();
    let second = api.lease("again", json!({"groups": 1})).await;
    assert_eq!(number(&second), number(&first) + 1);
    let late =
        api.post("/v1/runs/again/results", json!({"results": first.results("hold")[..1]})).await.expect(200);
    assert_eq!(late["results"][0]["status"], "refused", "{late}");
    archive_and_delete(&api, "again").await;
    server.restart().await;
    let api = server.api();
    create_again(&api, "again").await;
    let third = api.lease("again", json!({"groups": 1})).await;
    assert_eq!(number(&third), number(&second) + 1);
}
