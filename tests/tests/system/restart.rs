//! A restarted server proposes what it would have proposed, after a graceful stop and after a kill.

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, ServerProcess};

const RUN_SETTINGS: &str = r#"{"id": "run", "seed": 77, "group_size": 2, "target": "mastery", "design": {"designer": "off"}, "tasks": ["kessler/survival", "kessler/eco_station"]}"#;

/// Leases eight groups, reports their results and returns the leased groups.
async fn train_round(api: &ApiClient, number: usize) -> Vec<Value> {
    let lease = api.lease("run", json!({"groups": 8})).await;
    // The policy improves after four rounds; results are reported in two batches.
    let policy = if number < 4 { "hold" } else { "heuristic" };
    let results = lease.results(policy);
    for half in results.chunks(results.len() / 2 + 1) {
        api.report("run", half.to_vec()).await;
    }
    let group =
        |g: &Value| json!([g["scenario"], g["seed"], g["task"], g["level"], g["role"], g["contested"]]);
    lease.0["groups"].as_array().unwrap().iter().map(group).collect()
}

async fn create(api: &ApiClient) {
    let _ = api.post("/v1/runs", serde_json::from_str(RUN_SETTINGS).unwrap()).await.expect(201);
}

async fn mastery(api: &ApiClient) -> Value {
    api.get("/v1/runs/run/mastery").await.expect(200)
}

const ROUNDS: usize = 24;

#[tokio::test]
async fn restarted_server_proposes_the_same_groups() {
    let mut uninterrupted = Vec::new();
    let server = Server::start().await;
    create(&server.api()).await;
    for number in 0..ROUNDS {
        uninterrupted.extend(train_round(&server.api(), number).await);
    }
    let levels: std::collections::BTreeSet<String> = uninterrupted.iter().map(|g| g[3].to_string()).collect();
    assert!(levels.len() > 2, "the level must change during the test: {levels:?}");

    let mut interrupted = Vec::new();
    let mut restarted = Server::start().await;
    create(&restarted.api()).await;
    for number in 0..ROUNDS {
        if number % 5 == 2 {
            restarted.restart().await;
        }
        interrupted.extend(train_round(&restarted.api(), number).await);
    }
    assert_eq!(uninterrupted, interrupted);
    assert_eq!(mastery(&server.api()).await, mastery(&restarted.api()).await);

    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("killed.sqlite3");
    let mut process = ServerProcess::start(&db);
    create(&process.api()).await;
    let mut killed = Vec::new();
    for number in 0..ROUNDS {
        if number % 4 == 3 {
            process.kill(); // without a snapshot
            process = ServerProcess::start(&db);
        }
        killed.extend(train_round(&process.api(), number).await);
    }
    assert_eq!(uninterrupted, killed);
    assert_eq!(mastery(&server.api()).await, mastery(&process.api()).await);
}

#[cfg(unix)]
#[tokio::test]
async fn sigterm_checkpoints_and_keeps_mastery() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("stopped.sqlite3");
    let process = ServerProcess::start(&db);
    create(&process.api()).await;
    let first = train_round(&process.api(), 0).await;
    let before = mastery(&process.api()).await;
    assert_eq!(process.terminate(), Some(0));
    assert!(!folder.path().join("stopped.sqlite3-wal").exists(), "SIGTERM leaves no WAL file");
    let process = ServerProcess::start(&db);
    assert_eq!(mastery(&process.api()).await, before);
    assert_ne!(train_round(&process.api(), 1).await, first);
}

/// Kills a server during a batch. Acknowledged results are stored; the others count once when they are sent again.
#[tokio::test]
async fn kill_during_batch_counts_each_result_once() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("killed.sqlite3");
    let mut process = ServerProcess::start(&db);
    create(&process.api()).await;
    let mut acknowledged = 0;
    for number in 0..6u64 {
        let api = process.api();
        let lease = api.lease("run", json!({"groups": 32})).await;
        let results = lease.results("hold");
        let (first, second) = results.split_at(24);
        let response = api.report("run", first.to_vec()).await;
        assert!(response["results"].as_array().unwrap().iter().all(|r| r["status"] == "counted"));
        // The second batch is in flight when the server is killed.
        let sending = tokio::spawn({
            let (api, second) = (api.clone(), second.to_vec());
            async move {
                let body = json!({ "results": second }).to_string();
                let client = system_tests::http_client();
                let _ = client
                    .post(format!("{}/v1/runs/run/results", api.base()))
                    .header("content-type", "application/json")
                    .body(body)
                    .send()
                    .await;
            }
        });
        // Tests the passing of time: the kill comes at another moment of the report in each round.
        tokio::time::sleep(std::time::Duration::from_millis(3 * number)).await;
        process.kill();
        let _ = sending.await;
        process = ServerProcess::start(&db);
        let receipts = process.api().report("run", results.clone()).await;
        let statuses: Vec<&str> =
            receipts["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect();
        assert!(
            statuses[..24].iter().all(|w| *w == "duplicate"),
            "an acknowledged result is lost: {statuses:?}"
        );
        assert!(statuses[24..].iter().all(|w| *w == "duplicate" || *w == "counted"), "{statuses:?}");
        acknowledged += results.len() as u64;
        let mastery = mastery(&process.api()).await;
        let episodes: u64 = mastery["tasks"]
            .as_array()
            .unwrap()
            .iter()
            .map(|t| t["results"]["episodes"].as_u64().unwrap())
            .sum();
        assert_eq!(episodes, acknowledged);
    }
}
