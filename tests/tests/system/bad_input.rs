//! Invalid input: every request is rejected with a clear problem, and has no effect.

use serde_json::{Value, json};
use system_tests::{ApiResponse, IncompletePost, Server};

fn problem_line(response: &ApiResponse) -> String {
    assert_eq!(response.content_type, "application/problem+json", "{response:?}");
    assert_eq!(response.body["status"].as_u64(), Some(u64::from(response.status)));
    let field = response.body["field"].as_str().map(|f| format!(" [{f}]")).unwrap_or_default();
    let problem = response.body["type"].as_str().unwrap().trim_start_matches("urn:sparring:problem:");
    format!("{} {problem}{field}: {}", response.status, response.body["detail"].as_str().unwrap())
}

const JSON: &str = "application/json";

/// Request that the server must reject.
struct InvalidRequest {
    method: &'static str,
    path: &'static str,
    content_type: &'static str,
    body: &'static str,
}

const fn post(path: &'static str, body: &'static str) -> InvalidRequest {
    InvalidRequest { method: "POST", path, content_type: JSON, body }
}

const fn get(path: &'static str) -> InvalidRequest {
    InvalidRequest { method: "GET", path, content_type: JSON, body: "" }
}

const INVALID_REQUESTS: [InvalidRequest; 57] = [
    post("/v1/runs", "{"),
    post("/v1/runs", r#"{"seed": NaN}"#),
    post("/v1/runs", r#"{"contested_share": 1e999}"#),
    post("/v1/runs", r#"{"sed": 1}"#),
    post("/v1/runs", r#"{"seed": -1}"#),
    post("/v1/runs", r#"{"seed": 9007199254740992}"#),
    post("/v1/runs", r#"{"id": "run"}"#),
    post("/v1/runs", r#"{"id": "Über Run"}"#),
    post("/v1/runs", r#"{"strategy": "magic"}"#),
    post("/v1/runs", r#"{"contested_share": 1.5}"#),
    post("/v1/runs", r#"{"group_size": 0}"#),
    post("/v1/runs", r#"{"group_size": 4, "min_group": 5}"#),
    post("/v1/runs", r#"{"tasks": []}"#),
    post("/v1/runs", r#"{"tasks": ["kessler/golf"]}"#),
    post("/v1/runs", r#"{"tasks": ["kessler/survival", "kessler/survival"]}"#),
    post(
        "/v1/runs",
        r#"{"task_settings": {"kessler/survival": {"levels": {"columns": ["fuel"], "rows": [[100], []]}}}}"#,
    ),
    post(
        "/v1/runs",
        r#"{"task_settings": {"kessler/survival": {"levels": {"columns": ["fuel"], "rows": [[-1]]}}}}"#,
    ),
    post("/v1/runs", r#"[1, 2]"#),
    post("/v1/runs", "null"),
    post("/v1/runs", ""),
    post("/v1/runs", r#"{"seed": 1, "seed": 2}"#),
    post("/v1/runs", r#"{"seed": 2251799813685248}"#),
    post("/v1/runs", r#"{"success_threshold": 1e300}"#),
    post("/v1/runs", r#"{"task_settings": {"kessler/survival": [1]}}"#),
    post("/v1/runs", "[]"),
    post("/v1/runs", r#"{} {}"#),
    InvalidRequest { method: "POST", path: "/v1/runs", content_type: "text/plain", body: r#"{}"# },
    get("/v1/runs/unknown"),
    get("/v1/runs/NOBODY"),
    get("/v1/runs/unknown/episodes"),
    get("/v1/runs/unknown/leases"),
    get("/v1/runs/unknown/mastery"),
    get("/v1/runs/unknown/level_moves"),
    get("/v1/runs?limit=0"),
    get("/v1/runs?limit=many"),
    get("/v1/runs?limit=1&limit=2"),
    get("/v1/runs?limt=1"),
    get("/v1/runs?limit=%ff"),
    get("/v1/runs?cursor=7"),
    post("/v1/runs/unknown/leases", r#"{"groups": 1}"#),
    post("/v1/runs/run/leases", r#"{}"#),
    post("/v1/runs/run/leases", r#"{"groups": 0}"#),
    post("/v1/runs/run/leases", r#"{"groups": 4294967296}"#),
    post("/v1/runs/run/leases", r#"{"groups": 1024, "group_size": 1024}"#),
    post("/v1/runs/run/leases", r#"{"groups": 1, "ttl_s": 0}"#),
    post("/v1/runs/run/leases", r#"{"groups": 1, "purpose": "fun"}"#),
    get("/v1/runs/run/leases/42"),
    get("/v1/runs/run/leases/42-abcdef"),
    get("/v1/runs/run/episodes/ep_42-abcdef_0"),
    get("/v1/runs/run/episodes/42"),
    post("/v1/runs/run/results", r#"{"results": [{"episode": 3, "actions": []}]}"#),
    post("/v1/runs/run/results", r#"{"results": [{"score": 1.0}]}"#),
    post("/v1/runs/run/results", r#"{"results": [["x", "failed"]]}"#),
    post(
        "/v1/runs/run/results",
        r#"{"results": [{"episode": "x", "actions": {"steps": [[{"a": 1, "a": 2}]]}}]}"#,
    ),
    post("/v1/runs/unknown/results", r#"{"results": []}"#),
    get("/v1/nothing"),
    InvalidRequest { method: "DELETE", path: "/v1/runs", content_type: JSON, body: "" },
];

#[tokio::test]
async fn invalid_requests_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run", "seed": 1})).await.expect(201);
    let mut problems = Vec::new();
    for InvalidRequest { method, path, content_type, body } in INVALID_REQUESTS {
        let response = api.request(method, path, content_type, body.to_owned()).await;
        problems.push(format!("{method} {path} {body}\n    {}", problem_line(&response)));
    }
    insta::assert_snapshot!(problems.join("\n"));
    assert_eq!(
        api.get("/v1/runs").await.expect(200)["runs"].as_array().unwrap().len(),
        1,
        "no run was created"
    );
}

#[tokio::test]
async fn invalid_scenarios_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    let mut problems = Vec::new();
    for scenario in [
        json!({}),
        json!({"task": "kessler/survival"}),
        json!({"task": "kessler/survival", "seed": 1, "params": {"fuel": 0}}),
        json!({"task": "kessler/survival", "seed": 1, "params": {"debris": 1e6}}),
        json!({"task": "kessler/survival", "seed": 1, "gravity": "strong"}),
        json!({"task": "kessler/survival", "seed": (2u64 << 51) + 5}),
        json!({"task": "kessler/survival", "seed": 1u64 << 53}),
        json!({"task": "kessler/survival", "seed": 1.5}),
        json!({"task": "kessler/survival", "seed": 1, "params": {"fuel": 1e300}}),
        json!({"task": "kessler/survival", "seed": 1, "layout": {"mode": "extend", "bodies": {"moons": []}}}),
        json!({"task": "kessler/survival", "seed": 1, "layout": {"mode": "extend", "bodies": {"debris": vec![[60, 0, 0, 4]; 600]}}}),
    ] {
        problems.push(problem_line(&api.post("/v1/scenarios", json!({ "scenario": scenario })).await));
    }
    let scenario = json!({"task": "kessler/survival", "seed": 1});
    for steps in [
        json!([[[5, 0, 0]]]),
        json!([[], [[0, 0, 0], [0, 0, "x"]]]),
        json!(7),
        json!([]),
        json!(vec![json!([]); 51]),
    ] {
        let invalid = json!({"scenario": scenario, "actions": {"steps": steps}});
        problems.push(problem_line(&api.post("/v1/scenarios", invalid).await));
    }
    for invalid in [
        scenario.clone(),
        json!({"scenario": [1]}),
        json!({"scenario": scenario, "actions": []}),
        json!(null),
    ] {
        problems.push(problem_line(&api.post("/v1/scenarios", invalid).await));
    }
    insta::assert_snapshot!(problems.join("\n"));
}

#[tokio::test]
async fn scenario_endpoint_returns_bracket_and_replay() {
    let server = Server::start().await;
    let scenario = json!({"task": "kessler/survival", "params": {"debris": 100, "spread": 1.0}, "seed": 4});
    let body = json!({"scenario": scenario, "actions": {"steps": [], "stopped": "too_late"}});
    let checked = server.api().post("/v1/scenarios", body).await.expect(200);
    assert_eq!(checked["fair"], true);
    let (hold, reference) = (&checked["bracket"]["hold"], checked["bracket"]["reference"].as_f64().unwrap());
    assert_eq!(&checked["outcome"]["score"], hold, "an empty log is a holding policy");
    assert!(reference >= hold.as_f64().unwrap());
    // The returned scenario is complete: it has the same id when it is sent again.
    let repeated = json!({"scenario": checked["scenario"]});
    assert_eq!(
        server.api().post("/v1/scenarios", repeated).await.expect(200)["scenario_id"],
        checked["scenario_id"]
    );
}

/// Planning stops when its client disconnects, so that later requests are not delayed.
#[tokio::test]
async fn planning_stops_when_its_client_disconnects() {
    let server = Server::start().await;
    let api = server.api();
    // Each request takes seconds, and few run at a time.
    let heavy = json!({"scenario": {
        "task": "kessler/formation", "seed": 1, "physics": {"risk": "pc"},
        "params": {"debris": 1000, "spread": 1.0, "sigma": 10.0},
    }});
    for _ in 0..24 {
        let gone = tokio::time::timeout(
            std::time::Duration::from_millis(50),
            api.post("/v1/scenarios", heavy.clone()),
        );
        assert!(gone.await.is_err(), "the request must take longer than the test waits");
    }
    let light = json!({"scenario": {"task": "kessler/survival", "seed": 1}});
    let _ = api.post("/v1/scenarios", light).await.expect(200);
}

#[tokio::test]
async fn oversized_requests_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let item = json!({"episode": "ep_1-aaaaaa_0", "status": "failed"});
    let many = json!({"results": vec![item; 100_000]});
    let response = api.post("/v1/runs/run/results", many).await;
    insta::assert_snapshot!(problem_line(&response), @"422 invalid [results]: must have at most 5000 entries, got 100000");
    let huge = format!(r#"{{"results": [], "policy_version": {}1}}"#, " ".repeat(40 * 1024 * 1024));
    let response = api.request("POST", "/v1/runs/run/results", "application/json", huge).await;
    insta::assert_snapshot!(problem_line(&response), @"413 too_large: The body must have at most 16 MiB; send it in smaller requests.");
    let deep = format!(r#"{{"scenario": {}1{}}}"#, "[".repeat(100_000), "]".repeat(100_000));
    let response = api.request("POST", "/v1/scenarios", "application/json", deep).await;
    assert_eq!(response.status, 400, "{:?}", response.body);
    assert_eq!(api.get("/readyz").await.status, 200, "the server is ready");
}

#[tokio::test]
async fn openapi_document_and_viewer_are_served() {
    let server = Server::start().await;
    let api = server.api();
    let document = api.get("/openapi.json").await.expect(200);
    assert_eq!(document["openapi"], "3.1.0");
    assert!(document["paths"].as_object().unwrap().contains_key("/v1/runs/{run}/results"));
    let docs = api.get("/docs/").await;
    assert_eq!(docs.status, 200);
    assert!(matches!(docs.body, Value::String(page) if page.contains("swagger")));
}

/// Every route rejects unknown query parameters by name.
#[tokio::test]
async fn unknown_query_parameters_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run", "tasks": ["kessler/survival"]})).await.expect(201);
    for path in [
        "tasks",
        "runs",
        "runs/run",
        "runs/run/mastery",
        "runs/run/params",
        "runs/run/failure_profiles",
        "runs/run/leases",
    ] {
        let _ = api.get(&format!("/v1/{path}")).await.expect(200);
        let rejected = api.get(&format!("/v1/{path}?Telemetry=true")).await.expect(400);
        assert_eq!(rejected["field"], "Telemetry", "{path}: {rejected}");
    }
    let rejected = api.get("/v1/runs/run/episodes/ep_1-a_0/replay?Telemetry=true").await.expect(400);
    assert_eq!(rejected["field"], "Telemetry");
}

/// An incomplete body is rejected after a timeout, and other requests are served meanwhile.
#[tokio::test]
async fn incomplete_body_is_rejected_after_a_timeout() {
    let server = Server::start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let mut incomplete = Vec::new();
    for path in ["/v1/runs", "/v1/scenarios", "/v1/runs/run/leases", "/v1/runs/run/results"] {
        let mut post = IncompletePost::send_head(&api, path, 500).await;
        post.send_first_byte().await;
        incomplete.push(post);
    }
    assert_eq!(api.get("/v1/tasks").await.status, 200);
    for post in incomplete {
        let response = post.response().await;
        assert!(response.starts_with("HTTP/1.1 408") && response.contains("body_timeout"), "{response}");
    }
}
