//! Faults of designers and invalid design requests: the run continues, and the fault is reported.

use std::sync::Arc;

use orchestrator::service::Config;
use serde_json::json;
use system_tests::Server;

use super::scripted_designer::{Behaviour, DesignerScript, ScriptedDesigners, request_design};
use super::{create, design_summary, report_losses, wait_for_critiques, wait_for_response};

/// Starts a server whose designers follow the script.
async fn start_server(script: &DesignerScript) -> Server {
    let designers = Arc::new(ScriptedDesigners(script.clone()));
    Server::with_config(move |config| Config { designers: designers.clone(), ..config }).await
}

#[tokio::test]
async fn designer_faults_do_not_stop_the_run() {
    let script = DesignerScript::default();
    let server = start_server(&script).await;
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    report_losses(&api).await;
    wait_for_critiques(&api).await;
    // After a fault of the language model, the procedural designer takes over.
    for (behaviour, trouble) in [
        (Behaviour::Error, "connection refused"),
        (Behaviour::Panic, "it panicked: nonsense"),
        (Behaviour::Invalid, "blah"),
    ] {
        script.set_llm(behaviour);
        let request = request_design(&api, json!({"count": 2, "designer": "llm"})).await;
        assert_eq!(
            (&request["state"], &request["admitted"]),
            (&json!("done"), &json!(2)),
            "{behaviour:?}: {request}"
        );
        let warnings = request["warnings"].as_array().unwrap();
        assert!(warnings.iter().any(|t| t.as_str().unwrap().contains(trouble)), "{behaviour:?}: {request}");
        if behaviour == Behaviour::Invalid {
            assert_eq!((&request["refused"], &request["cost"]), (&json!(100), &json!(0.0)));
            let path = format!(
                "/v1/runs/run/designs?state=refused&request={}&limit=500",
                request["id"].as_str().unwrap()
            );
            let stored = api.get(&path).await.expect(200);
            let stored = stored["designs"].as_array().unwrap();
            assert!(
                stored.len() <= 64
                    && stored.iter().all(|d| d["name"].as_str().unwrap().chars().count() <= 200)
            );
            let rejected = stored[0]["id"].as_str().unwrap();
            let path = format!("/v1/runs/run/designs/{rejected}/retire");
            assert_eq!(api.post(&path, json!({})).await.status, 409);
            assert_eq!(api.get(&format!("/v1/layouts/{rejected}")).await.status, 404);
            let rejections = &design_summary(&api).await["tasks"][0]["refused"];
            let schema = rejections.as_array().unwrap().iter().find(|c| c["check"] == "schema").unwrap();
            assert_eq!(schema["count"], 100, "all are counted, although only some are stored");
        }
    }
    // A fault of the procedural designer fails the request, and nothing else.
    script.set_procedural(Behaviour::Panic);
    let request = request_design(&api, json!({"count": 2, "designer": "procedural"})).await;
    assert_eq!(request["state"], "failed", "{request}");
    assert!(request["error"].as_str().unwrap().contains("nonsense"));
    let lease = api.lease("run", json!({"groups": 4})).await;
    api.report("run", lease.results("hold")).await;
    script.set_procedural(Behaviour::Normal);
    let request = request_design(&api, json!({"designer": "procedural", "count": 1})).await;
    assert_eq!(request["state"], "done", "{request}");
}

#[tokio::test]
async fn interrupted_design_request_fails_and_the_next_one_runs() {
    let script = DesignerScript::default();
    script.set_llm(Behaviour::Hang);
    let mut server = start_server(&script).await;
    create(&server.api(), json!({"designer": "off"})).await;
    report_losses(&server.api()).await;
    wait_for_critiques(&server.api()).await;
    let response =
        server.api().post("/v1/runs/run/designs", json!({"designer": "llm", "count": 1})).await.expect(202);
    let path = format!("/v1/runs/run/designs/requests/{}", response["id"].as_str().unwrap());
    wait_for_response(&server.api(), &path, |request| request["state"] == "running").await;
    // Requests run one at a time: the next one waits.
    let next = server.api().post("/v1/runs/run/designs", json!({"count": 1, "designer": "procedural"})).await;
    let next = next.expect(202);
    let lease = server.api().lease("run", json!({"groups": 4})).await;
    server.api().report("run", lease.results("hold")).await;
    assert_eq!(server.api().get(&path).await.expect(200)["state"], "running");
    server.restart().await;
    let api = server.api();
    let request = api.get(&path).await.expect(200);
    assert_eq!(request["state"], "failed");
    assert!(request["error"].as_str().unwrap().starts_with("interrupted"), "{request}");
    let path = format!("/v1/runs/run/designs/requests/{}", next["id"].as_str().unwrap());
    let next = wait_for_response(&api, &path, |request| request["ended_at"].is_string()).await;
    assert_eq!((&next["state"], &next["admitted"]), (&json!("done"), &json!(1)), "{next}");
}

/// Runs and bodies of invalid `POST …/designs` requests.
const INVALID_REQUESTS: [(&str, &str); 12] = [
    ("run", "{}"),
    ("run", "[]"),
    ("run", r#"{"count": 0, "designer": "auto"}"#),
    ("run", r#"{"count": 33, "designer": "auto"}"#),
    ("run", r#"{"count": "many"}"#),
    ("run", r#"{"designer": "llm"}"#),
    ("run", r#"{"designer": "off"}"#),
    ("run", r#"{"designer": "chance"}"#),
    ("run", r#"{"designer": "auto", "task": "kessler/rendezvous"}"#),
    ("run", r#"{"layouts": 3}"#),
    ("run", r#"{"count": 1, "count": 2}"#),
    ("unknown", r#"{"count": 1}"#),
];

/// Paths with invalid queries and unknown resources.
const INVALID_PATHS: [&str; 18] = [
    "/v1/runs/run/designs?state=lost",
    "/v1/runs/run/designs?task=kessler/rendezvous",
    "/v1/runs/run/designs?request=7",
    "/v1/runs/run/designs?limit=0",
    "/v1/runs/run/designs?cursor=x",
    "/v1/runs/run/designs?page=2",
    "/v1/runs/unknown/designs",
    "/v1/runs/run/designs/7",
    "/v1/runs/run/designs/layout-7",
    "/v1/runs/run/designs/requests?state=admitted",
    "/v1/runs/run/designs/requests/ask-7",
    "/v1/runs/run/designs/statistics?task=x",
    "/v1/layouts?state=refused",
    "/v1/layouts?task=kessler/golf",
    "/v1/layouts?task=kessler/survival&aim=boredom",
    "/v1/runs/run/designs?mode=boredom",
    "/v1/layouts/layout-7",
    "/v1/layouts/layout-07",
];

#[tokio::test]
async fn invalid_bodies_and_queries_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    let mut problems = Vec::new();
    let mut record = |title: String, response: system_tests::ApiResponse| {
        assert_eq!(response.content_type, "application/problem+json", "{title}");
        problems.push(format!("{title}\n{:#}", response.body));
    };
    for (run, body) in INVALID_REQUESTS {
        let path = format!("/v1/runs/{run}/designs");
        record(format!("POST {path} {body}"), api.request("POST", &path, "application/json", body).await);
    }
    for path in INVALID_PATHS {
        record(format!("GET {path}"), api.get(path).await);
    }
    for design in [
        json!({"share": 1.5}),
        json!({"layout_share": 0}),
        json!({"reserve": 0}),
        json!({"reserve": 65}),
        json!({"designer": "unknown"}),
        json!({"shares": 0.5}),
        json!("off"),
    ] {
        record(
            format!("POST /v1/runs design: {design}"),
            api.post("/v1/runs", json!({"design": design})).await,
        );
    }
    insta::assert_snapshot!("problems", problems.join("\n\n"));
}
