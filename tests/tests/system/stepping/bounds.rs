//! What is too much, and what it does to others.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use orchestrator::service::Config;
use orchestrator::sessions::Limits;
use serde_json::json;
use system_tests::{Process, Server};

use super::client::{Came, Socket, Vector, head, opening};
use super::single::to_the_end;

#[tokio::test]
async fn a_frame_that_is_too_large_ends_the_connection_and_not_the_session() {
    let server = Server::start().await;
    let api = server.api();
    let (mut vector, _) = Vector::open(&api, json!({"seed": 1, "vector": {"envs": 3}})).await;
    let mut large = head(1, 1, 3);
    large.resize(15 << 20, 0);
    vector.socket.bytes(&large).await;
    assert_eq!(vector.socket.told().await["field"], "length", "15 MiB are read");
    large.resize(17 << 20, 0);
    vector.socket.too_many_bytes(&large).await;
    // What is still being sent when it is closed may keep the code from being read.
    assert!(matches!(vector.socket.next().await, Came::Closed(1009 | 1006)));
    drop(vector.socket);
    let (socket, resumed) = Socket::resume(&api, &vector.opened).await;
    assert_eq!(resumed["type"], "resumed", "{resumed}");
    vector.socket = socket;
    assert_eq!(vector.step(&vec![0.0; vector.width()]).await.sequence, 1);
}

#[tokio::test]
async fn places_are_bounded_and_given_again() {
    let limits = Limits { most: 3, ..Limits::default() };
    let server = Server::set_up(move |config| Config { sessions: limits, ..config }).await;
    let api = server.api();
    let mut open = Vec::new();
    for seed in 0..3 {
        let wish = if seed == 0 { json!({"vector": {"envs": 2}}) } else { json!({"seed": seed}) };
        open.push(Socket::open(&api, wish).await.0);
    }
    let mut fourth = Socket::to(&api).await;
    let full = fourth.ask(opening(json!({"seed": 4}))).await;
    assert_eq!((&full["code"], &full["retryable"]), (&json!("at_capacity"), &json!(true)), "{full}");
    open.pop().unwrap().leave().await;
    for _ in 0..100 {
        if fourth.ask(opening(json!({"seed": 4}))).await["type"] == "opened" {
            return;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("what was freed is not given again");
}

#[tokio::test]
async fn a_silent_session_ends() {
    let limits = Limits { idle: Some(Duration::from_millis(300)), ..Limits::default() };
    let server = Server::set_up(move |config| Config { sessions: limits, ..config }).await;
    let (mut socket, opened) = Socket::open(&server.api(), json!({"seed": 1})).await;
    assert_eq!(socket.told().await["code"], "silent");
    assert_eq!(socket.next().await, Came::Closed(1000));
    let (_, told) = Socket::resume(&server.api(), &opened).await;
    assert_eq!(told["code"], "unknown_session");
}

const UPGRADE: &str = "GET /v1/sessions HTTP/1.1\r\nhost: localhost\r\nconnection: upgrade\r\nupgrade: websocket\r\n\
                       sec-websocket-version: 13\r\nsec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n";

/// Connections that open nothing: bare ones, upgraded ones, and ones that announce 15 MiB and send the first bytes of it.
fn half_open(address: &str, count: usize) -> Vec<TcpStream> {
    let mut all = Vec::new();
    for number in 0..count {
        let Ok(mut stream) = TcpStream::connect(address) else { break };
        if number % 3 > 0 {
            stream.write_all(UPGRADE.as_bytes()).unwrap();
            let mut answer = [0; 12];
            stream.read_exact(&mut answer).unwrap();
            assert_eq!(&answer, b"HTTP/1.1 101");
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

fn resident_mib(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() / 1024
}

/// As many as this process may have, 10 000 at most.
#[cfg(target_os = "linux")]
#[tokio::test(flavor = "multi_thread")]
async fn thousands_of_half_open_sockets_hurt_nobody() {
    let limits = std::fs::read_to_string("/proc/self/limits").unwrap();
    let line = limits.lines().find(|line| line.starts_with("Max open files")).unwrap();
    let soft: usize = line.split_whitespace().nth(3).unwrap().parse().unwrap_or(1 << 20);
    let count = soft.saturating_sub(400).min(10_000);
    let folder = tempfile::tempdir().unwrap();
    let server = Process::start(&folder.path().join("db.sqlite3"));
    let before = resident_mib(server.pid());
    let address = server.api().base().trim_start_matches("http://").to_owned();
    let sockets = tokio::task::spawn_blocking(move || half_open(&address, count)).await.unwrap();
    assert_eq!(sockets.len(), count);
    let (mut socket, _) = Socket::open(&server.api(), json!({"seed": 1})).await;
    let begun = Instant::now();
    let last = to_the_end(&mut socket, 1).await;
    assert_eq!(last["done"], true);
    // Fifty steps take milliseconds; seconds would mean that somebody is held up.
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
    let (mut vector, _) = Vector::open(&server.api(), json!({"seed": 1, "vector": {"envs": 64}})).await;
    assert_eq!(vector.step(&vec![0.0; vector.width()]).await.sequence, 1);
    assert_eq!(server.api().get("/livez").await.status, 200);
    let grown = resident_mib(server.pid()).saturating_sub(before);
    // About 30 KiB each: a task, a buffer, the connection's own state.
    assert!(grown < 100 + count as u64 / 10, "{grown} MiB more for {count} sockets");
    // Who opens nothing is sent away.
    tokio::time::sleep(Duration::from_secs(12)).await;
    let mut bytes = Vec::new();
    let mut upgraded = &sockets[1];
    upgraded.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    upgraded.read_to_end(&mut bytes).unwrap();
    assert!(String::from_utf8_lossy(&bytes).contains("\"silent\""), "{bytes:?}");
    assert_eq!(socket.ask(json!({"type": "close"})).await["type"], "closed", "who opened stays");
}
