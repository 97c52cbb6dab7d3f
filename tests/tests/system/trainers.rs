//! Activity of trainers, and the health of the server.

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, http_client};

/// Sends a request with the name of a trainer. Returns the response's body.
async fn send_as(server: &Server, name: &str, path: &str, body: &Value) -> Value {
    let request =
        http_client().post(format!("{}{path}", server.api().base())).header("Sparring-Client", name);
    request.json(body).send().await.unwrap().json().await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn trainers_are_listed_with_their_work() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"id": "r", "tasks": ["kessler/survival"], "strategy": "ladder", "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    assert_eq!(api.get("/v1/runs/r/trainers").await.expect(200)["trainers"], json!([]));
    let lease = api.lease("r", json!({"groups": 2, "policy_version": 3})).await;
    let results = json!({"results": lease.results("hold"), "policy_version": 5});
    let _ = send_as(&server, "gpu-3:4711", "/v1/runs/r/results", &results).await;
    let _ = send_as(&server, "gpu-3:4711", "/v1/runs/r/leases", &json!({"groups": 0})).await;
    let list = api.get("/v1/runs/r/trainers").await.expect(200);
    let [named, plain] = &list["trainers"].as_array().unwrap()[..] else { panic!("two trainers: {list}") };
    assert_eq!(
        (&named["name"], &named["errors"], &named["leases"]),
        (&json!("gpu-3:4711"), &json!(1), &json!(0))
    );
    assert!(named["episodes_per_s"].as_f64() > Some(0.0), "{named}");
    assert_eq!((&named["policy_version"], &named["staleness"]), (&json!(5), &json!(0)));
    assert_eq!((&plain["name"], &plain["leases"]), (&Value::Null, &json!(1)));
    assert_eq!((&plain["policy_version"], &plain["staleness"]), (&json!(3), &json!(2)));
    assert!(
        plain["lease_wait_s"].as_f64() > Some(0.0) && plain["waiting_share"].as_f64() <= Some(1.0),
        "{plain}"
    );
    assert_eq!(api.get("/v1/runs/gone/trainers").await.status, 404);
}

#[tokio::test(flavor = "multi_thread")]
async fn health_of_the_server_is_in_one_place() {
    let server = Server::start().await;
    let api: ApiClient = server.api();
    let _ = api.post("/v1/runs", json!({"id": "r", "tasks": ["kessler/survival"]})).await.expect(201);
    let health = api.get("/v1/health").await.expect(200);
    assert_eq!((&health["outage"], &health["writer"]["queue_capacity"]), (&Value::Null, &json!(1024)));
    assert!(health["writer"]["commit_p99_ms"].as_f64() >= health["writer"]["commit_p50_ms"].as_f64());
    assert!(health["writer"]["commit_p50_ms"].as_f64() > Some(0.0), "{health}");
    assert!(health["disk"]["database_bytes"].as_i64() > Some(0) && health["uptime_s"].as_f64() > Some(0.0));
    #[cfg(target_os = "linux")]
    assert!(health["disk"]["free_bytes"].as_u64() > Some(0));
}
