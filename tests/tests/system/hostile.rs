//! Whatever comes over the network is answered or closed: no failure, no panic, and the server goes on. Valid requests are bent out of
//! shape, byte by byte and value by value; what speaks HTTP or WebSockets badly comes, too.

use std::process::{Command, Stdio};
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use system_tests::{Api, Process, binary, result};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;

/// Requests of each kind; SPARRING_HOSTILE for more by hand.
fn rounds() -> u64 {
    std::env::var("SPARRING_HOSTILE").ok().and_then(|rounds| rounds.parse().ok()).unwrap_or(60)
}

/// Draws, the same each time (SplitMix64: Steele, Lea and Flood 2014).
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    fn one<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }
}

/// A value that nobody wants.
fn nasty(draws: &mut Draws) -> Value {
    match draws.below(16) {
        0 => json!(null),
        1 => json!(-1),
        2 => json!(u64::MAX),
        3 => json!(i64::MIN),
        4 => json!(1e308),
        5 => json!(-0.0),
        6 => json!(""),
        7 => json!("\u{0}\u{202e}é\u{fffd}"),
        8 => json!("x".repeat(70_000)),
        9 => json!([]),
        10 => json!({}),
        11 => json!(true),
        12 => (0..100).fold(json!(1), |inner, _| json!([inner])),
        13 => json!(vec![0; 3000]),
        14 => json!("1-aaaaaa"),
        _ => json!({"": {"": []}}),
    }
}

/// Bends one place of a value.
fn bend(value: &mut Value, draws: &mut Draws) {
    let deeper = draws.below(4) > 0;
    match value {
        Value::Object(fields) if deeper && !fields.is_empty() => {
            let key = fields.keys().nth(draws.below(fields.len())).unwrap().clone();
            match draws.below(8) {
                0 => drop(fields.remove(&key)),
                1 => drop(fields.insert(format!("{key}_"), nasty(draws))),
                _ => bend(fields.get_mut(&key).unwrap(), draws),
            }
        }
        Value::Array(items) if deeper && !items.is_empty() => {
            let at = draws.below(items.len());
            match draws.below(8) {
                0 => drop(items.remove(at)),
                1 => items.extend(std::iter::repeat_n(nasty(draws), 3)),
                _ => bend(&mut items[at], draws),
            }
        }
        _ => *value = nasty(draws),
    }
}

/// Bends bytes.
fn scramble(bytes: &mut Vec<u8>, draws: &mut Draws) {
    for _ in 0..=draws.below(4) {
        let at = draws.below(bytes.len() + 1);
        match draws.below(4) {
            0 => bytes.truncate(at),
            1 => bytes.insert(at, draws.next() as u8),
            2 if at < bytes.len() => bytes[at] = draws.next() as u8,
            _ => bytes.extend(draws.next().to_le_bytes()),
        }
    }
}

/// Valid bodies, by method and path.
async fn bodies(api: &Api) -> Vec<(&'static str, String, Value)> {
    let _ = api.post("/v1/runs", json!({"id": "run", "group_size": 2})).await.expect(201);
    let lease = api.lease("run", json!({"groups": 3, "ttl_s": 600})).await;
    let results: Vec<Value> = lease.episodes().iter().map(|(id, s)| result(id, s, "random")).collect();
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

/// A server whose log is kept: what panicked stands there.
fn start(folder: &std::path::Path) -> Process {
    let mut command = Command::new(binary());
    command.args(["--log", "error", "serve", "--bind", "127.0.0.1:0", "--db"]).arg(folder.join("db.sqlite3"));
    Process::run(command, Stdio::from(std::fs::File::create(folder.join("log")).unwrap()))
}

async fn still_well(api: &Api, folder: &std::path::Path) {
    assert_eq!(api.get("/readyz").await.status, 200);
    let log = std::fs::read_to_string(folder.join("log")).unwrap();
    assert!(!log.contains("panicked"), "{log}");
}

#[tokio::test(flavor = "multi_thread")]
async fn bodies_out_of_shape() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    let api = server.api();
    for (place, (method, path, valid)) in bodies(&api).await.into_iter().enumerate() {
        let mut draws = Draws(place as u64);
        for round in 0..rounds() {
            let mut value = valid.clone();
            for _ in 0..=draws.below(2) {
                bend(&mut value, &mut draws);
            }
            let packed = round % 3 == 0;
            let (kind, mut bytes) = match packed {
                true => ("application/msgpack", rmp_serde::to_vec(&value).unwrap()),
                false => ("application/json", value.to_string().into_bytes()),
            };
            if round % 2 == 0 {
                scramble(&mut bytes, &mut draws);
            }
            let told = api.raw(method, &path, kind, bytes.clone()).await;
            let fine = told.status < 500 || told.status == 503;
            assert!(fine, "{method} {path} {} {}", told.body, String::from_utf8_lossy(&bytes));
        }
    }
    still_well(&api, folder.path()).await;
}

/// What stands in paths, queries and headers.
const WORDS: &[&str] = &[
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
/// Fields of queries.
const FIELDS: &[&str] =
    &["limit", "cursor", "wait_s", "ttl_s", "after", "state", "task", "aim", "telemetry", "mode", "ask", "x"];
/// Where there is something, or nothing.
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
    "/v1/runs/run/designs/asks/{}",
    "/v1/layouts",
    "/v1/layouts/{}",
    "/v1/runs/run/failures/list",
    "/v1/runs/run/mastery/history",
    "/v1/runs/run/trajectories",
    "/v1/audit",
    "/v1/runs",
    "/state",
    "/metadata",
    "/docs/{}",
    "/{}",
];

#[tokio::test(flavor = "multi_thread")]
async fn paths_queries_and_headers_out_of_shape() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let mut draws = Draws(1);
    for _ in 0..rounds() * 6 {
        let (route, word) = (*draws.one(ROUTES), *draws.one(WORDS));
        let mut path = route.replace("{}", word);
        for place in 0..draws.below(3) {
            let (field, word) = (*draws.one(FIELDS), *draws.one(WORDS));
            let value = if field == "wait_s" { "0" } else { word };
            path.push_str(&format!("{}{field}={value}", if place == 0 { '?' } else { '&' }));
        }
        // By hand: a client would mend it first.
        let header = format!(
            "{}: {}\r\n",
            draws.one(&["accept", "authorization", "x-request-id", "content-type", "origin-x", "cookie"]),
            draws.one(WORDS)
        );
        let request = format!(
            "GET {} HTTP/1.1\r\nhost: 127.0.0.1\r\nconnection: close\r\n{header}\r\n",
            path.replace(' ', "%20").replace('\'', "%27")
        );
        let answer = exchange(server.address(), request.as_bytes()).await;
        let status: u16 = answer.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
        assert!((200..500).contains(&status) || status == 503, "{request}{answer}");
    }
    still_well(&api, folder.path()).await;
}

/// Sends bytes, and reads until the other side closes or is silent.
async fn exchange(address: &str, bytes: &[u8]) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    let _ = stream.write_all(bytes).await;
    let mut answer = Vec::new();
    let _ = tokio::time::timeout(Duration::from_secs(10), stream.read_to_end(&mut answer)).await;
    String::from_utf8_lossy(&answer).into_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_hardly_http() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    let address = server.address().to_owned();
    let valid = b"POST /v1/runs HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-type: application/json\r\ncontent-length: 2\r\nconnection: close\r\n\r\n{}";
    let mut draws = Draws(2);
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
        scramble(&mut bytes, &mut draws);
        bytes.extend(b"\r\n\r\n");
        sent.push(bytes);
    }
    let exchanges = sent.into_iter().map(|bytes| {
        let address = address.clone();
        async move {
            let mut stream = TcpStream::connect(&address).await.unwrap();
            let _ = stream.write_all(&bytes).await;
            let _ = stream.shutdown().await; // nothing more comes: it need not wait
            let mut answer = Vec::new();
            let _ = tokio::time::timeout(Duration::from_secs(10), stream.read_to_end(&mut answer)).await;
            let answer = String::from_utf8_lossy(&answer).into_owned();
            assert!(!answer.starts_with("HTTP/1.1 500"), "{} {answer}", String::from_utf8_lossy(&bytes));
        }
    });
    futures_util::future::join_all(exchanges).await;
    still_well(&server.api(), folder.path()).await;
}

/// There is no way to end a connection of HTTP/2 that is silent, nor one that has not said yet which it is.
#[tokio::test(flavor = "multi_thread")]
async fn http_2_is_not_spoken() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    for preface in [&b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0"[..], b"PRI * HTTP/2.0\r\n\r\n"] {
        let mut stream = TcpStream::connect(server.address()).await.unwrap();
        stream.write_all(preface).await.unwrap();
        let mut answer = Vec::new();
        let ended = tokio::time::timeout(Duration::from_secs(10), stream.read_to_end(&mut answer)).await;
        assert!(ended.is_ok(), "it waits for more");
        let answer = String::from_utf8_lossy(&answer).into_owned();
        assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 4"), "{answer}");
    }
    still_well(&server.api(), folder.path()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn messages_out_of_shape() {
    let folder = tempfile::tempdir().unwrap();
    let server = start(folder.path());
    let api = server.api();
    let _ = api.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let opening =
        json!({"type": "open", "version": 1, "seed": 1, "task": "kessler/survival", "params": {"debris": 3}});
    let vector = json!({"type": "open", "version": 1, "seed": 1, "vector": {"envs": 2, "autoreset": "next_step", "observe": "tracks"}});
    let step = json!({"type": "step", "id": 1, "action": {"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0}]}});
    let reset = json!({"type": "reset", "data": {"seed": 1, "task": "survival"}});
    let call = json!({"jsonrpc": "2.0", "id": 1, "method": "openenv/session/create", "params": {"seed": 1}});
    let talks: [(&str, Vec<Value>); 4] = [
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
    for (place, (path, messages)) in talks.iter().enumerate() {
        let mut draws = Draws(10 + place as u64);
        for round in 0..rounds() {
            let (mut socket, _) =
                connect_async(format!("{}{path}", api.base().replacen("http", "ws", 1))).await.unwrap();
            for message in messages {
                let mut message = message.clone();
                if draws.below(3) > 0 {
                    bend(&mut message, &mut draws);
                }
                let mut bytes = message.to_string().into_bytes();
                if draws.below(3) == 0 {
                    scramble(&mut bytes, &mut draws);
                }
                let sent = match String::from_utf8(bytes) {
                    Ok(text) if round % 4 > 0 => Message::text(text),
                    Ok(text) => Message::binary(text.into_bytes()),
                    Err(bytes) => Message::binary(bytes.into_bytes()),
                };
                if socket.send(sent).await.is_err() {
                    break;
                }
                // It answers, or closes; what is no frame may be answered by nothing.
                if tokio::time::timeout(Duration::from_millis(1500), socket.next())
                    .await
                    .is_ok_and(|came| came.is_none())
                {
                    break;
                }
            }
        }
    }
    still_well(&api, folder.path()).await;
}
