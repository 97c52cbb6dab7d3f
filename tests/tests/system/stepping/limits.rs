//! Limits of sessions: frame size, number of sessions, idle time and connections that never open a session.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use orchestrator::service::Config;
use orchestrator::sessions::SessionLimits;
use serde_json::json;
use system_tests::{ApiClient, Received, Server, ServerProcess, upgrade_raw, wait_until};

use super::client::{SessionSocket, VectorSession, frame_header, open_message};
use super::single::hold_to_the_end;

#[tokio::test]
async fn oversized_frame_closes_the_connection_not_the_session() {
    let server = Server::start().await;
    let api = server.api();
    let (mut vector, _) = VectorSession::open(&api, json!({"seed": 1, "vector": {"envs": 3}})).await;
    let mut large = frame_header(1, 1, 3);
    large.resize(15 << 20, 0);
    vector.socket.send_bytes(&large).await;
    assert_eq!(vector.socket.receive_text().await["field"], "length", "frames of 15 MiB are read");
    large.resize(17 << 20, 0);
    vector.socket.try_send_bytes(&large).await;
    // Unsent data may keep the client from reading the close code.
    assert!(matches!(vector.socket.receive().await, Received::Closed(1009 | 1006)));
    drop(vector.socket);
    let (socket, resumed) = SessionSocket::resume(&api, &vector.opened).await;
    assert_eq!(resumed["type"], "resumed", "{resumed}");
    vector.socket = socket;
    assert_eq!(vector.step(&vec![0.0; vector.action_len()]).await.sequence, 1);
}

#[tokio::test]
async fn number_of_sessions_is_bounded_and_reused() {
    let limits = SessionLimits { max_sessions: 3, ..SessionLimits::default() };
    let server = Server::with_config(move |config| Config { sessions: limits, ..config }).await;
    let api = server.api();
    let mut open = Vec::new();
    for seed in 0..3 {
        let options = if seed == 0 { json!({"vector": {"envs": 2}}) } else { json!({"seed": seed}) };
        open.push(SessionSocket::open(&api, options).await.0);
    }
    let mut fourth = SessionSocket::connect(&api).await;
    let full = fourth.request(&open_message(json!({"seed": 4}))).await;
    assert_eq!((&full["code"], &full["retryable"]), (&json!("at_capacity"), &json!(true)), "{full}");
    open.pop().unwrap().close().await;
    wait_until("the place of the closed session is free", async || {
        fourth.request(&open_message(json!({"seed": 4}))).await["type"] == "opened"
    })
    .await;
}

#[tokio::test]
async fn idle_session_ends() {
    let limits = SessionLimits { idle_timeout: Some(Duration::from_secs(3)), ..SessionLimits::default() };
    let server = Server::with_config(move |config| Config { sessions: limits, ..config }).await;
    let (mut socket, opened) = SessionSocket::open(&server.api(), json!({"seed": 1})).await;
    assert_eq!(socket.receive_text().await["code"], "idle_timeout");
    assert_eq!(socket.receive().await, Received::Closed(1000));
    let (_, reply) = SessionSocket::resume(&server.api(), &opened).await;
    assert_eq!(reply["code"], "unknown_session");
}

/// Opens connections without a session: plain TCP, upgraded, and upgraded with the start of a frame of 15 MiB.
fn open_half(address: &str, count: usize) -> Vec<TcpStream> {
    let mut all = Vec::new();
    for number in 0..count {
        let Ok(mut stream) = TcpStream::connect(address) else { break };
        if number % 3 > 0 {
            upgrade_raw(&mut stream, "/v1/sessions");
        }
        if number % 3 == 2 {
            let mut frame = vec![0x82, 0xff];
            frame.extend((15u64 << 20).to_be_bytes());
            frame.extend([0; 1000]);
            stream.write_all(&frame).unwrap();
        }
        all.push(stream);
    }
    all
}

/// Opens a session, holds to the end of its episode, and returns how long both took.
async fn time_an_episode(api: &ApiClient) -> Duration {
    let start = Instant::now();
    let (mut socket, _) = SessionSocket::open(api, json!({"seed": 1})).await;
    assert_eq!(hold_to_the_end(&mut socket, 1).await["done"], true);
    start.elapsed()
}

/// Opens as many sockets as the limit of this process allows, at most 10 000.
#[cfg(target_os = "linux")]
#[tokio::test(flavor = "multi_thread")]
async fn half_open_sockets_do_not_block_sessions() {
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap();
    let line = limits.lines().find(|line| line.starts_with("Max open files")).unwrap();
    let soft: usize = line.split_whitespace().nth(3).unwrap().parse().unwrap_or(1 << 20);
    let count = soft.saturating_sub(400).min(10_000);
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let before = server.resident_mib();
    let baseline = time_an_episode(&server.api()).await;
    let address = server.api().base().trim_start_matches("http://").to_owned();
    let sockets = tokio::task::spawn_blocking(move || open_half(&address, count)).await.unwrap();
    assert_eq!(sockets.len(), count);
    let took = time_an_episode(&server.api()).await;
    // A session that waits for half-open sockets waits for their timeout of 10 s; a busy machine slows both episodes down.
    assert!(took < Duration::from_secs(9) + 10 * baseline, "{took:?}, without the sockets {baseline:?}");
    let (mut socket, _) = SessionSocket::open(&server.api(), json!({"seed": 1})).await;
    let (mut vector, _) =
        VectorSession::open(&server.api(), json!({"seed": 1, "vector": {"envs": 64}})).await;
    assert_eq!(vector.step(&vec![0.0; vector.action_len()]).await.sequence, 1);
    assert_eq!(server.api().get("/livez").await.status, 200);
    let growth_mib = server.resident_mib().saturating_sub(before);
    // About 30 KiB each: a task, a buffer, the connection's own state.
    assert!(growth_mib < 100 + count as u64 / 10, "the memory grew by {growth_mib} MiB for {count} sockets");
    // Connections that open no session are closed after 10 s; the read waits for that.
    let mut bytes = Vec::new();
    let mut upgraded = &sockets[1];
    upgraded.set_read_timeout(Some(Duration::from_secs(120))).unwrap();
    upgraded.read_to_end(&mut bytes).unwrap();
    assert!(String::from_utf8_lossy(&bytes).contains("\"idle_timeout\""), "{bytes:?}");
    assert_eq!(socket.request(&json!({"type": "close"})).await["type"], "closed", "the open session remains");
}
