//! A server that is stopped, or killed, proposes what it would have proposed, and has lost nothing it acknowledged.

use serde_json::{Value, json};
use system_tests::{Api, Process, Server, result};

const WISH: &str = r#"{"id": "run", "seed": 77, "group_size": 2, "target": "mastery", "design": {"designer": "off"}, "tasks": ["kessler/survival", "kessler/eco_station"]}"#;

/// One round of a trainer; what it was given.
async fn round(api: &Api, number: usize) -> Vec<Value> {
    let lease = api.lease("run", json!({"groups": 8})).await;
    // A trainer that gets better, and reports in two batches.
    let policy = if number < 4 { "hold" } else { "heuristic" };
    let results: Vec<Value> = lease.episodes().iter().map(|(id, s)| result(id, s, policy)).collect();
    for half in results.chunks(results.len() / 2 + 1) {
        api.report("run", half.to_vec()).await;
    }
    let group =
        |g: &Value| json!([g["scenario"], g["seed"], g["task"], g["level"], g["role"], g["contested"]]);
    lease.0["groups"].as_array().unwrap().iter().map(group).collect()
}

async fn create(api: &Api) {
    let _ = api.post("/v1/runs", serde_json::from_str(WISH).unwrap()).await.expect(201);
}

async fn standing(api: &Api) -> Value {
    api.get("/v1/runs/run/mastery").await.expect(200)
}

const ROUNDS: usize = 24;

#[tokio::test]
async fn a_restarted_server_proposes_what_it_would_have_proposed() {
    let mut steady = Vec::new();
    let server = Server::start().await;
    create(&server.api()).await;
    for number in 0..ROUNDS {
        steady.extend(round(&server.api(), number).await);
    }
    let levels: std::collections::BTreeSet<String> = steady.iter().map(|g| g[3].to_string()).collect();
    assert!(levels.len() > 2, "difficulty moved, or this proves little: {levels:?}");

    let mut interrupted = Vec::new();
    let mut other = Server::start().await;
    create(&other.api()).await;
    for number in 0..ROUNDS {
        if number % 5 == 2 {
            other.restart().await;
        }
        interrupted.extend(round(&other.api(), number).await);
    }
    assert_eq!(steady, interrupted);
    assert_eq!(standing(&server.api()).await, standing(&other.api()).await);

    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("killed.sqlite3");
    let mut process = Process::start(&db);
    create(&process.api()).await;
    let mut killed = Vec::new();
    for number in 0..ROUNDS {
        if number % 4 == 3 {
            process.kill(); // no snapshot, no farewell
            process = Process::start(&db);
        }
        killed.extend(round(&process.api(), number).await);
    }
    assert_eq!(steady, killed);
    assert_eq!(standing(&server.api()).await, standing(&process.api()).await);
}

#[cfg(unix)]
#[tokio::test]
async fn sigterm_ends_it_in_good_order() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("stopped.sqlite3");
    let process = Process::start(&db);
    create(&process.api()).await;
    let first = round(&process.api(), 0).await;
    let before = standing(&process.api()).await;
    assert_eq!(process.terminate(), Some(0));
    assert!(!folder.path().join("stopped.sqlite3-wal").exists(), "the log was folded into the database");
    let process = Process::start(&db);
    assert_eq!(standing(&process.api()).await, before);
    assert_ne!(round(&process.api(), 1).await, first);
}

/// Killed in the middle of a batch: what was acknowledged is there, what was not counts once when sent again.
#[tokio::test]
async fn nothing_acknowledged_is_lost_and_nothing_counts_twice() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("killed.sqlite3");
    let mut process = Process::start(&db);
    create(&process.api()).await;
    let mut acknowledged = 0;
    for number in 0..6u64 {
        let api = process.api();
        let lease = api.lease("run", json!({"groups": 32})).await;
        let results: Vec<Value> = lease.episodes().iter().map(|(id, s)| result(id, s, "hold")).collect();
        let (first, second) = results.split_at(24);
        let answer = api.report("run", first.to_vec()).await;
        assert!(answer["results"].as_array().unwrap().iter().all(|r| r["status"] == "counted"));
        // The second batch is under way when the server dies.
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
        tokio::time::sleep(std::time::Duration::from_millis(3 * number)).await;
        process.kill();
        let _ = sending.await;
        process = Process::start(&db);
        let again = process.api().report("run", results.clone()).await;
        let words: Vec<&str> =
            again["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect();
        assert!(words[..24].iter().all(|w| *w == "duplicate"), "acknowledged and lost: {words:?}");
        assert!(words[24..].iter().all(|w| *w == "duplicate" || *w == "counted"), "{words:?}");
        acknowledged += results.len() as u64;
        let standing = standing(&process.api()).await;
        let episodes: u64 = standing["tasks"]
            .as_array()
            .unwrap()
            .iter()
            .map(|t| t["plain"]["episodes"].as_u64().unwrap())
            .sum();
        assert_eq!(episodes, acknowledged);
    }
}
