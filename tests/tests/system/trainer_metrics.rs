//! Metrics that a trainer logs: stored by step, thinned, bounded in names and rate, and read as curves.

use serde_json::{Value, json};
use system_tests::{ApiClient, ApiResponse, Server};

const PATH: &str = "/v1/runs/r/metrics";

async fn start() -> Server {
    let server = Server::start().await;
    let request = json!({"id": "r", "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = server.api().post("/v1/runs", request).await.expect(201);
    server
}

/// Sends metrics, again after each time that the rate limit refused them.
async fn log(api: &ApiClient, step: u64, metrics: Value) -> ApiResponse {
    loop {
        let response = api.post(PATH, json!({"step": step, "metrics": metrics.clone()})).await;
        if response.status != 429 {
            return response;
        }
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
    }
}

/// Returns the metric of a response by its name.
fn metric<'a>(response: &'a Value, name: &str) -> &'a Value {
    let metrics = response["metrics"].as_array().unwrap();
    metrics.iter().find(|metric| metric["name"] == name).unwrap()
}

#[tokio::test]
async fn metrics_are_stored_by_step_and_survive_a_restart() {
    let mut server = start().await;
    let api = server.api();
    assert_eq!(api.get(PATH).await.expect(200), json!({"metrics": []}));
    let receipt = log(&api, 10, json!({"train/loss": 0.5, "train/kl": 0.01})).await.expect(200);
    assert_eq!(receipt, json!({"step": 10, "stored": 2, "metrics": 2}));
    let receipt = log(&api, 20, json!({"train/loss": null, "entropy": -1.5})).await.expect(200);
    assert_eq!(receipt, json!({"step": 20, "stored": 2, "metrics": 3}));
    // A repeated request replaces its values, and an earlier step may follow.
    let _ = log(&api, 10, json!({"train/loss": 0.25})).await.expect(200);
    let _ = log(&api, 5, json!({"train/loss": 8})).await.expect(200);
    server.restart().await;
    let curves = server.api().get(PATH).await.expect(200);
    let names: Vec<_> = curves["metrics"].as_array().unwrap().iter().map(|metric| &metric["name"]).collect();
    assert_eq!(names, ["entropy", "train/kl", "train/loss"]);
    let loss = metric(&curves, "train/loss");
    assert_eq!((&loss["step"], &loss["value"]), (&json!([5, 10, 20]), &json!([8.0, 0.25, null])));
    assert!(loss["at"].as_array().unwrap().iter().all(|at| at.as_f64().unwrap() > 1.7e9));
    assert_eq!(loss["last_value"], Value::Null);
    assert_eq!(metric(&curves, "entropy")["last_value"], json!(-1.5));
    let one = server.api().get(&format!("{PATH}?name=entropy")).await.expect(200);
    assert_eq!(metric(&one, "entropy")["value"], json!([-1.5]));
    let none = server.api().get(&format!("{PATH}?to=2020-01-01T00:00:00Z&from=2019-01-01T00:00:00Z")).await;
    assert_eq!(none.expect(200), json!({"metrics": []}));
}

#[tokio::test]
async fn points_are_means_of_successive_reports() {
    let server = start().await;
    let api = server.api();
    for step in 0..6 {
        let value = if step == 4 { Value::Null } else { json!(step) };
        let _ = log(&api, step, json!({ "loss": value })).await.expect(200);
    }
    let curves = api.get(&format!("{PATH}?points=3")).await.expect(200);
    let loss = metric(&curves, "loss");
    assert_eq!((&loss["step"], &loss["value"]), (&json!([1, 3, 5]), &json!([0.5, 2.5, 5.0])));
    assert_eq!(metric(&api.get(&format!("{PATH}?points=1")).await.expect(200), "loss")["last_value"], 5.0);
}

#[tokio::test]
async fn invalid_metrics_are_rejected() {
    let server = start().await;
    let api = server.api();
    let many = |n: usize| Value::from_iter((0..n).map(|n| (format!("m{n}"), json!(n))));
    let _ = log(&api, 0, many(99)).await.expect(200);
    let mut problems = Vec::new();
    for body in [
        json!({"metrics": {"loss": 1}}),
        json!({"step": 1}),
        json!({"step": -1, "metrics": {"loss": 1}}),
        json!({"step": 1.5, "metrics": {"loss": 1}}),
        json!({"step": 1_u64 << 53, "metrics": {"loss": 1}}),
        json!({"step": 1, "metrics": {}}),
        json!({"step": 1, "metrics": {"a b": 1}}),
        json!({"step": 1, "metrics": {"loss": "0.5"}}),
        json!({"step": 1, "metrics": many(101)}),
        json!({"step": 1, "metrics": {"loss": 1, "kl": 1}}),
        json!({"step": 1, "metrics": {"loss": 1}, "at": 3}),
    ] {
        let response = loop {
            let response = api.post(PATH, body.clone()).await;
            if response.status != 429 {
                break response;
            }
            tokio::time::sleep(std::time::Duration::from_millis(100)).await;
        };
        let problem = response.expect(422);
        problems.push(format!(
            "{}: {}",
            problem["field"].as_str().unwrap_or_default(),
            problem["detail"].as_str().unwrap()
        ));
    }
    let not_finite = r#"{"step": 1, "metrics": {"loss": NaN}}"#.to_owned();
    let problem = api.request("POST", PATH, "application/json", not_finite).await.expect(422);
    problems.push(format!("{}: {}", problem["field"].as_str().unwrap(), problem["detail"].as_str().unwrap()));
    for query in ["name=a%20b", "points=0", "from=today"] {
        let problem = api.get(&format!("{PATH}?{query}")).await.expect(422);
        problems.push(format!(
            "{}: {}",
            problem["field"].as_str().unwrap(),
            problem["detail"].as_str().unwrap()
        ));
    }
    insta::assert_snapshot!(problems.join("\n"));
    assert_eq!(log(&api, 1, json!({"loss": 1})).await.expect(200)["metrics"], 100);
    assert_eq!(log(&api, 1, json!({"kl": 1})).await.expect(422)["field"], "metrics");
    let missing = api.post("/v1/runs/missing/metrics", json!({"step": 1, "metrics": {"loss": 1}})).await;
    assert_eq!(missing.expect(404)["type"], "urn:sparring:problem:unknown_run");
}

#[tokio::test]
async fn rate_of_a_run_is_limited_without_others() {
    let server = start().await;
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "other", "design": {"designer": "off"}})).await.expect(201);
    let mut refused = None;
    for step in 0..200 {
        let response = api.post(PATH, json!({"step": step, "metrics": {"loss": 1}})).await;
        if response.status == 429 {
            refused = Some(response);
            break;
        }
    }
    let refused = refused.expect("the server accepts no 200 requests at once");
    assert_eq!(refused.retry_after.as_deref(), Some("1"));
    let other = api.post("/v1/runs/other/metrics", json!({"step": 1, "metrics": {"loss": 1}})).await;
    assert_eq!(other.expect(200)["stored"], 1);
}
