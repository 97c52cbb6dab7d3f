//! Layouts that workers design: the same as the server's, and by a language model that only a worker has.

use serde_json::Value;
use system_tests::mock_llm::{API_KEY, chat_response, contains_api_key, start_endpoint};
use system_tests::worker_cluster::{WorkerProcess, is_prepared, nats_options};
use system_tests::{ApiClient, wait_until};

use super::servers::{OptionServer, done_remotely, wait_for_kind, workers};
use super::*;
use crate::design::{create, report_losses, request_design, wait_for_critiques};
use crate::trajectories::number;

/// Environment variable with the key of the language model, which only workers have.
const KEY_VARIABLE: &str = "DESIGN_TEST_KEY";

/// Starts a worker that designs.
fn design_worker(nats: &NatsServer, options: &[&str]) -> WorkerProcess {
    let url = nats.url();
    let options = [&["--nats", &url, "--jobs", "design"], options].concat();
    WorkerProcess::start_with_variables(&options, &[(KEY_VARIABLE, API_KEY)])
}

/// Designs before and after losses, then stops the server and returns its tables. Workers do `remote_jobs` jobs.
async fn designed(server: OptionServer, remote_jobs: i64) -> StoredState {
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    request_procedural(&api).await;
    report_losses(&api).await;
    wait_for_critiques(&api).await;
    request_procedural(&api).await;
    assert_eq!(done_remotely(&api).await, remote_jobs);
    let db = server.folder.path().join("db.sqlite3");
    wait_until("the queue is prepared", async || is_prepared(&db).await).await;
    assert_eq!(server.process.terminate(), Some(0));
    read_state(&db).await
}

async fn request_procedural(api: &ApiClient) {
    let request = request_design(api, json!({"count": 6, "designer": "procedural"})).await;
    assert_eq!((&request["state"], &request["admitted"]), (&json!("done"), &json!(6)), "{request}");
}

#[tokio::test(flavor = "multi_thread")]
async fn layouts_of_a_worker_are_those_of_the_server() {
    let Some(nats) = NatsServer::start() else { return };
    let server = OptionServer::start(&nats_options(&nats.url()));
    let _worker = design_worker(&nats, &[]);
    let api = server.api();
    wait_for_kind(&api, "design_procedural").await;
    assert_eq!(workers(&api).await["workers"][0]["kinds"], json!(["design_procedural"]));
    let helped = designed(server, 2).await;
    let alone = designed(OptionServer::start(&[]), 0).await;
    assert!(alone.rows("layouts") >= 12 && alone.rows("design_requests") == 2, "there is enough to compare");
    alone.assert_equal(&helped, "with a worker that designs");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_without_a_language_model_designs_by_that_of_a_worker() {
    let Some(nats) = NatsServer::start() else { return };
    let server = OptionServer::start(&nats_options(&nats.url()));
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    let refused = api.post("/v1/runs/run/designs", json!({"designer": "llm"})).await.expect(422);
    assert!(refused["detail"].as_str().unwrap().contains("nor a connected worker"), "{refused}");
    report_losses(&api).await;
    wait_for_critiques(&api).await;

    let mock = start_endpoint([chat_response(LAYOUTS)]).await;
    let url = format!("{}/v1", mock.uri());
    let options = [
        "--llm-url",
        &url,
        "--llm-model",
        "mock",
        "--llm-key-env",
        KEY_VARIABLE,
        "--llm-price-in",
        "1",
        "--llm-price-out",
        "1",
    ];
    let _worker = design_worker(&nats, &options);
    wait_for_kind(&api, "design_llm").await;
    let request = request_design(&api, json!({"count": 2, "designer": "llm"})).await;
    assert_eq!(
        (&request["model"], &request["admitted"], &request["tokens_in"]),
        (&json!("mock"), &json!(2), &json!(900)),
        "{request}"
    );
    assert!((request["cost"].as_f64().unwrap() - 0.00092).abs() < 1e-12, "{request}");
    let list = api.get("/v1/runs/run/designs").await.expect(200);
    let designers: Vec<&Value> =
        list["designs"].as_array().unwrap().iter().map(|design| &design["designer"]).collect();
    assert_eq!(designers, ["llm", "llm"], "{list:#}");
    assert_eq!(done_remotely(&api).await, 1);
    for entry in std::fs::read_dir(server.folder.path()).unwrap() {
        assert!(!contains_api_key(&std::fs::read(entry.unwrap().path()).unwrap()));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_procedural_designer_replaces_a_model_without_layouts() {
    let Some(nats) = NatsServer::start() else { return };
    let server = OptionServer::start(&nats_options(&nats.url()));
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    let mock = start_endpoint([chat_response("I would rather write a poem about the sea.")]).await;
    let url = format!("{}/v1", mock.uri());
    let _worker =
        design_worker(&nats, &["--llm-url", &url, "--llm-model", "prose", "--llm-key-env", KEY_VARIABLE]);
    wait_for_kind(&api, "design_llm").await;
    let request = request_design(&api, json!({"count": 1, "designer": "llm"})).await;
    assert_eq!((&request["state"], &request["admitted"]), (&json!("done"), &json!(1)), "{request}");
    assert!(request["warnings"].to_string().contains("has no layouts"), "{request}");
    let list = workers(&api).await;
    assert_eq!(number(&list["counters"]["done_remotely"]), 2, "both designers: {list}");
    assert_eq!(number(&list["workers"][0]["errors"]), 0, "{list}");
}
