//! Heads of requests: hosts, versions of HTTP, and slashes at the end of paths.

use serde_json::json;
use system_tests::ServerProcess;

use super::exchange;

/// Returns the status of the response to a head, and its body.
fn get(address: &str, line: &str, headers: &str) -> (u16, String) {
    let response = exchange(address, &format!("{line}\r\n{headers}connection: close\r\n\r\n"));
    let (head, body) = response.split_once("\r\n\r\n").unwrap();
    (head.split(' ').nth(1).unwrap().parse().unwrap(), body.to_owned())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_request_names_one_host() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let address = server.address().to_owned();
    let get = |line: &'static str, headers: &'static str| {
        let address = address.clone();
        tokio::task::spawn_blocking(move || get(&address, line, headers))
    };
    let runs = "GET /v1/runs HTTP/1.1";
    assert_eq!(get(runs, "host: localhost\r\n").await.unwrap().0, 200);
    for two in ["host: localhost\r\nhost: localhost\r\n", "host: localhost\r\nHost: evil.example\r\n"] {
        let (status, body) = get(runs, two).await.unwrap();
        assert_eq!(status, 400, "{body}");
        assert!(body.contains("\"Host\"") && body.contains("must be sent once, got 2 headers"), "{body}");
    }
    let (status, body) = get(runs, "").await.unwrap();
    assert_eq!(status, 400, "{body}");
    assert!(body.contains("must be sent with a request of HTTP/1.1"), "{body}");
    let old = "GET /v1/runs HTTP/1.0";
    assert_eq!(get(old, "").await.unwrap().0, 200, "HTTP/1.0 needs no host");
    assert_eq!(get(old, "origin: https://evil.example\r\n").await.unwrap().0, 403);
    assert_eq!(get(old, "host: evil.example\r\n").await.unwrap().0, 403);
}

#[tokio::test]
async fn openenv_paths_may_end_with_a_slash() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let api = server.api();
    let _ = api.post("/reset/", json!({"seed": 1})).await.expect(200);
    let _ = api.post("/step/", json!({"burns": []})).await.expect(200);
    assert_eq!(api.get("/state/").await.expect(200)["step_count"], 1);
    let _ = api.post("/mcp/", json!({"jsonrpc": "2.0", "id": 1, "method": "tools/list"})).await.expect(200);
    let _ = api.post("/web/reset/", json!({})).await.expect(200);
    let _ = api.post("/web/step/", json!({})).await.expect(200);
    let paths =
        ["/health", "/metadata", "/schema", "/manifest.json", "/ws", "/ws/ui", "/web/metadata", "/web/state"];
    for path in paths {
        let (without, with) = (api.get(path).await, api.get(&format!("{path}/")).await);
        assert_eq!((without.status, &without.body), (with.status, &with.body), "{path}");
    }
    assert_eq!(api.get("/schema/?task=formation").await.body, api.get("/schema?task=formation").await.body);
}
