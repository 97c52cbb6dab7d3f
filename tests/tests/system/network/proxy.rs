//! The server behind nginx with its default settings: HTTP/1.0 towards the server, and responses in buffers.

use std::time::{Duration, Instant};

use serde_json::json;
use system_tests::nginx::NginxProxy;
use system_tests::{ServerProcess, http_client};

/// Time in which an event must pass the proxy.
const DELIVERY: Duration = Duration::from_secs(5);

#[tokio::test(flavor = "multi_thread")]
async fn events_pass_nginx_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let nginx = NginxProxy::start(server.api().base()).await;
    let api = nginx.api();
    let _ = api.post("/v1/runs", json!({"id": "run", "design": {"designer": "off"}})).await.expect(201);
    let events = format!("{}/v1/runs/run/events", api.base());
    let opened = Instant::now();
    let mut stream = tokio::time::timeout(DELIVERY, http_client().get(events).send())
        .await
        .expect("nginx passes the head of the stream on at once")
        .unwrap();
    assert_eq!(stream.headers()["cache-control"], "no-store, no-transform");
    let mut text = String::new();
    for action in ["pause", "resume"] {
        let _ = api.post(&format!("/v1/runs/run/{action}"), json!({})).await.expect(200);
        let state = format!("{action}d");
        while !text.contains(&state) {
            let part = tokio::time::timeout(DELIVERY, stream.chunk()).await;
            let part = part.unwrap_or_else(|_| panic!("nginx withholds the event {state}: {text:?}"));
            text.push_str(&String::from_utf8_lossy(&part.unwrap().expect("the stream goes on")));
        }
    }
    assert!(opened.elapsed() < 3 * DELIVERY, "{:?}", opened.elapsed());
}

#[tokio::test(flavor = "multi_thread")]
async fn long_poll_passes_nginx() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let nginx = NginxProxy::start(server.api().base()).await;
    let api = nginx.api();
    let run = json!({"id": "run", "tasks": ["kessler/survival"], "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", run).await.expect(201);
    let empty = api.get("/v1/runs/run/trajectories?wait_s=1").await.expect(200);
    assert_eq!(empty["groups"], json!([]));
    let wait = tokio::spawn({
        let api = api.clone();
        async move { api.get("/v1/runs/run/trajectories?wait_s=60").await }
    });
    let _ = api.send_json("PUT", "/v1/runs/run/policy", json!({"policy": "hold"})).await.expect(200);
    let page = wait.await.unwrap().expect(200);
    assert!(!page["groups"].as_array().unwrap().is_empty(), "{page}");
}
