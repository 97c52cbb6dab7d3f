//! Fuzz tests of the network interface. The server answers or closes whatever it receives, never fails or panics, and keeps
//! running. The tests mutate valid requests by bytes and by JSON values, and send malformed HTTP and WebSocket traffic.

use std::process::{Command, Stdio};
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use fuzz_targets::mutation::{mutate_bytes, mutate_value};
use fuzz_targets::random::Random;
use serde_json::{Value, json};
use system_tests::{ApiClient, ServerProcess, sparring_binary};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;

/// Time that the server has to end a response, on a machine that may be busy.
const TIMEOUT: Duration = Duration::from_secs(120);

/// Number of requests of each kind; the environment variable `SPARRING_FUZZ_ROUNDS` overrides the default of 60.
fn rounds() -> u64 {
    std::env::var("SPARRING_FUZZ_ROUNDS").ok().and_then(|rounds| rounds.parse().ok()).unwrap_or(60)
}

/// Returns valid requests for most operations with a body: method, path and body.
async fn valid_requests(api: &ApiClient) -> Vec<(&'static str, String, Value)> {
    let _ =
        api.post("/v1/runs", json!({"id": "run", "strategy": "ladder", "group_size": 2})).await.expect(201);
    let lease = api.lease("run", json!({"groups": 3, "ttl_s": 600})).await;
    let results = lease.results("random");
    let columns = api.lease("run", json!({"groups": 8, "form": "columns", "ttl_s": 600})).await;
    let scenario = lease.episodes()[0].1.to_json();
    let run = |path: &str| format!("/v1/runs/run{path}");
    let settings = json!({"name": "x", "seed": 1, "strategy": "ladder", "target": "half", "placement": false, "contested_share": 0.5,
        "frontier_share": 0.5, "group_size": 2, "min_group": 1, "max_staleness": 3, "evidence_from": "train", "success": "raw",
        "tasks": ["kessler/survival"], "design": {"designer": "procedural", "share": 0.1}, "audit_groups": 3, "judge": "off",
        "retention": {"episodes": 100, "claimed": "all"},
        "task_settings": {"kessler/survival": {"weight": 2, "success_threshold": 0.5, "physics": {"contact": "swept"},
            "levels": {"columns": ["debris"], "rows": [[10], [20]]}}}});
    vec![
        ("POST", "/v1/runs".to_owned(), settings),
        (
            "POST",
            run("/leases"),
            json!({"groups": 1, "group_size": 1, "policy_version": 0, "ttl_s": 5, "purpose": "train", "form": "groups"}),
        ),
        ("POST", run("/results"), json!({"policy_version": 1, "results": results})),
        (
            "POST",
            run(&format!("/leases/{}/columns", columns.id())),
            json!({"policy_version": 1, "score": vec![0.5; 8], "failed": [0, 0, 0, 0, 0, 0, 0, 0], "steps": vec![50; 8]}),
        ),
        ("POST", run("/designs"), json!({"task": "kessler/survival", "count": 1})),
        ("PUT", run("/policy"), json!({"policy": "off", "version": 1})),
        ("PUT", run("/policy_version"), json!({"policy_version": 1})),
        ("PUT", run("/retention"), json!({"episodes": 1000, "claimed": "all"})),
        ("POST", run("/trajectories/claim"), json!({"limit": 2, "ttl_s": 5})),
        ("POST", run("/trajectories/ack"), json!({"ids": [1, 2]})),
        ("POST", "/v1/scenarios".to_owned(), json!({"scenario": scenario, "policy": "hold"})),
        (
            "POST",
            "/reset".to_owned(),
            json!({"seed": 1, "episode_id": "x", "task": "survival", "params": {"debris": 3}, "physics": {"contact": "swept"}}),
        ),
        (
            "POST",
            "/step".to_owned(),
            json!({"action": {"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0.0}]}, "timeout_s": 3}),
        ),
        (
            "POST",
            "/mcp".to_owned(),
            json!({"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": {"name": "burn", "arguments": {"burns": []}}}),
        ),
    ]
}

/// Starts a server whose log goes to the file `log`, so that a panic is found.
fn start(folder: &std::path::Path) -> ServerProcess {
    let mut command = Command::new(sparring_binary());
    command.args(["--log", "error", "serve", "--bind", "127.0.0.1:0", "--db"]).arg(folder.join("db.sqlite3"));
    ServerProcess::spawn(command, Stdio::from(std::fs::File::create(folder.join("log")).unwrap()))
}

/// Checks that the server is ready and has not panicked.
async fn assert_healthy(api: &ApiClient, folder: &std::path::Path) {
    assert_eq!(api.get("/readyz").await.status, 200);
    let log = std::fs::read_to_string(folder.join("log")).unwrap();
    assert!(!log.contains("panicked"), "{log}");
}

#[tokio::test(flavor = "multi_thread")]
async fn mutated_bodies_never_fail_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    let api = server.api();
    for (place, (method, path, valid)) in valid_requests(&api).await.into_iter().enumerate() {
        let mut random = Random(place as u64);
        for round in 0..rounds() {
            let mut value = valid.clone();
            for _ in 0..=random.below(2) {
                mutate_value(&mut value, &mut random);
            }
            let packed = round % 3 == 0;
            let (kind, mut bytes) = match packed {
                true => ("application/msgpack", rmp_serde::to_vec(&value).unwrap()),
                false => ("application/json", value.to_string().into_bytes()),
            };
            if round % 2 == 0 {
                mutate_bytes(&mut bytes, &mut random);
            }
            let response = api.request(method, &path, kind, bytes.clone()).await;
            let fine = response.status < 500 || response.status == 503;
            assert!(fine, "{method} {path} {} {}", response.body, String::from_utf8_lossy(&bytes));
        }
    }
    assert_healthy(&api, folder.path()).await;
}

/// Values for parts of paths, query fields and headers.
const PATH_VALUES: &[&str] = &[
    "run",
    "1-aaaaaa",
    "ep_1-aaaaaa_0",
    "layout-1",
    "ask-1",
    "%00",
    "%ff%fe",
    "..",
    "%2e%2e%2f",
    "0",
    "-1",
    "99999999999999999999",
    "é",
    "a%20b",
    "",
    "x",
    "'; DROP TABLE runs; --",
];
/// Names of query fields.
const QUERY_FIELDS: &[&str] = &[
    "limit",
    "cursor",
    "wait_s",
    "ttl_s",
    "after",
    "state",
    "task",
    "aim",
    "telemetry",
    "mode",
    "request",
    "x",
];
/// Paths with a placeholder for a value.
const ROUTES: &[&str] = &[
    "/v1/runs/{}",
    "/v1/runs/{}/episodes",
    "/v1/runs/run/episodes/{}",
    "/v1/runs/run/episodes/{}/replay",
    "/v1/runs/run/leases",
    "/v1/runs/run/leases/{}",
    "/v1/runs/run/leases/{}/columns",
    "/v1/runs/run/designs",
    "/v1/runs/run/designs/{}",
    "/v1/runs/run/designs/requests/{}",
    "/v1/layouts",
    "/v1/layouts/{}",
    "/v1/runs/run/failures",
    "/v1/runs/run/level_moves",
    "/v1/runs/run/trajectories",
    "/v1/audit",
    "/v1/runs",
    "/state",
    "/metadata",
    "/docs/{}",
    "/{}",
];

#[tokio::test(flavor = "multi_thread")]
async fn mutated_paths_and_headers_never_fail_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let mut random = Random(1);
    for _ in 0..rounds() * 6 {
        let (route, word) = (*random.choose(ROUTES), *random.choose(PATH_VALUES));
        let mut path = route.replace("{}", word);
        for place in 0..random.below(3) {
            let (field, word) = (*random.choose(QUERY_FIELDS), *random.choose(PATH_VALUES));
            let value = if field == "wait_s" { "0" } else { word };
            path.push_str(&format!("{}{field}={value}", if place == 0 { '?' } else { '&' }));
        }
        // Written by hand, because an HTTP client would correct it.
        let header = format!(
            "{}: {}\r\n",
            random.choose(&["accept", "authorization", "x-request-id", "content-type", "origin-x", "cookie"]),
            random.choose(PATH_VALUES)
        );
        let request = format!(
            "GET {} HTTP/1.1\r\nhost: 127.0.0.1\r\nconnection: close\r\n{header}\r\n",
            path.replace(' ', "%20").replace('\'', "%27")
        );
        let response = send_raw(server.address(), request.as_bytes()).await;
        let status: u16 = response.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
        assert!((200..500).contains(&status) || status == 503, "{request}{response}");
    }
    assert_healthy(&api, folder.path()).await;
}

/// Sends bytes and reads until the server closes the connection or is silent for two minutes.
async fn send_raw(address: &str, bytes: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    let _ = stream.write_all(bytes).await;
    let mut response = Vec::new();
    let _ = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut response)).await;
    String::from_utf8_lossy(&response).into_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn malformed_http_never_fails_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    let address = server.address().to_owned();
    let valid = b"POST /v1/runs HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-type: application/json\r\ncontent-length: 2\r\nconnection: close\r\n\r\n{}";
    let mut random = Random(2);
    let mut sent: Vec<Vec<u8>> = vec![
        b"GET / HTTP/9.9\r\n\r\n".to_vec(),
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\nnonsense".to_vec(),
        [b"GET /".to_vec(), vec![b'a'; 70_000], b" HTTP/1.1\r\n\r\n".to_vec()].concat(),
        [b"GET / HTTP/1.1\r\n".to_vec(), b"a: b\r\n".repeat(500), b"\r\n".to_vec()].concat(),
        b"POST /v1/runs HTTP/1.1\r\nhost: x\r\ntransfer-encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFFF\r\n"
            .to_vec(),
        b"POST /v1/runs HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-length: 5\r\ncontent-length: 6\r\n\r\nhello"
            .to_vec(),
        vec![0; 1000],
    ];
    for _ in 0..rounds() {
        let mut bytes = valid.to_vec();
        mutate_bytes(&mut bytes, &mut random);
        bytes.extend(b"\r\n\r\n");
        sent.push(bytes);
    }
    let exchanges = sent.into_iter().map(|bytes| {
        let address = address.clone();
        async move {
            let mut stream = TcpStream::connect(&address).await.unwrap();
            let _ = stream.write_all(&bytes).await;
            let _ = stream.shutdown().await; // so that the server does not wait for more
            let mut response = Vec::new();
            let _ = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut response)).await;
            let response = String::from_utf8_lossy(&response).into_owned();
            assert!(!response.starts_with("HTTP/1.1 500"), "{} {response}", String::from_utf8_lossy(&bytes));
        }
    });
    futures_util::future::join_all(exchanges).await;
    assert_healthy(&server.api(), folder.path()).await;
}

/// The server speaks HTTP/1 only: it could not end a silent HTTP/2 connection, nor one whose protocol is still undecided.
#[tokio::test(flavor = "multi_thread")]
async fn http_2_connections_are_closed() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    for preface in [&b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0"[..], b"PRI * HTTP/2.0\r\n\r\n"] {
        let mut stream = TcpStream::connect(server.address()).await.unwrap();
        stream.write_all(preface).await.unwrap();
        let mut response = Vec::new();
        let ended = tokio::time::timeout(TIMEOUT, stream.read_to_end(&mut response)).await;
        assert!(ended.is_ok(), "the server waits for more bytes");
        let response = String::from_utf8_lossy(&response).into_owned();
        assert!(response.is_empty() || response.starts_with("HTTP/1.1 4"), "{response}");
    }
    assert_healthy(&server.api(), folder.path()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn mutated_messages_never_fail_the_server() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let opening =
        json!({"type": "open", "version": 2, "seed": 1, "task": "kessler/survival", "params": {"debris": 3}});
    let vector = json!({"type": "open", "version": 2, "seed": 1, "vector": {"envs": 2, "autoreset": "next_step", "observe": "tracks"}});
    let step = json!({"type": "step", "id": 1, "action": {"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0}]}});
    let reset = json!({"type": "reset", "data": {"seed": 1, "task": "survival"}});
    let call = json!({"jsonrpc": "2.0", "id": 1, "method": "openenv/session/create", "params": {"seed": 1}});
    let conversations: [(&str, Vec<Value>); 4] = [
        ("/v1/sessions", vec![opening, step.clone()]),
        ("/v1/sessions", vec![vector, json!({"type": "state"})]),
        (
            "/ws",
            vec![reset, json!({"type": "step", "data": step["action"].clone()}), json!({"type": "state"})],
        ),
        (
            "/mcp",
            vec![
                call,
                json!({"jsonrpc": "2.0", "id": 2, "method": "tools/call", "params": {"name": "burn", "arguments": {}}}),
            ],
        ),
    ];
    for (place, (path, messages)) in conversations.iter().enumerate() {
        let mut random = Random(10 + place as u64);
        for round in 0..rounds() {
            let (mut socket, _) = connect_async(api.websocket_url(path)).await.unwrap();
            for message in messages {
                let mut message = message.clone();
                if random.below(3) > 0 {
                    mutate_value(&mut message, &mut random);
                }
                let mut bytes = message.to_string().into_bytes();
                if random.below(3) == 0 {
                    mutate_bytes(&mut bytes, &mut random);
                }
                let sent = match String::from_utf8(bytes) {
                    Ok(text) if round % 4 > 0 => Message::text(text),
                    Ok(text) => Message::binary(text.into_bytes()),
                    Err(bytes) => Message::binary(bytes.into_bytes()),
                };
                if socket.send(sent).await.is_err() {
                    break;
                }
                // The server replies or closes; it may ignore what is no frame, so that no reply is valid, too.
                let reply = tokio::time::timeout(Duration::from_millis(1500), socket.next()).await;
                if reply.is_ok_and(|message| message.is_none()) {
                    break;
                }
            }
        }
    }
    assert_healthy(&api, folder.path()).await;
}
