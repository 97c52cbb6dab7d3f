//! WebSockets of clients that send pings and never read the pongs.

use std::io::Write;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::json;
use system_tests::{ServerProcess, raw_frame, upgrade_raw};
use tokio::net::TcpSocket;

use crate::openenv::socket::OpenEnvSocket;

/// Time for which each client sends pings.
const FLOOD: Duration = Duration::from_secs(3);
/// Largest growth of the server's memory, in MiB, for all clients together.
const MAX_GROWTH_MIB: u64 = 12;

/// Connects with a small receive buffer, so that few pongs fill the connection.
async fn connect(address: &str) -> TcpStream {
    let socket = TcpSocket::new_v4().unwrap();
    socket.set_recv_buffer_size(4096).unwrap();
    let stream = socket.connect(address.parse().unwrap()).await.unwrap().into_std().unwrap();
    stream.set_nonblocking(false).unwrap();
    stream
}

/// Sends pings of 125 bytes as fast as the server reads them.
fn send_pings(mut stream: TcpStream, path: &str) -> usize {
    upgrade_raw(&mut stream, path);
    // The server stops reading, so that a write must not wait for ever.
    stream.set_write_timeout(Some(Duration::from_millis(100))).unwrap();
    let pings = raw_frame(0x89, &[7; 125]).repeat(500);
    let (until, mut at, mut sent) = (Instant::now() + FLOOD, 0, 0);
    while Instant::now() < until {
        // A timeout may cut a frame, so that the next write goes on at the same byte.
        if let Ok(written) = stream.write(&pings[at..]) {
            at = (at + written) % pings.len();
            sent += written;
        }
    }
    sent
}

#[tokio::test(flavor = "multi_thread")]
async fn pings_of_a_client_that_never_reads_use_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &["--openenv-public"]);
    let mut other = OpenEnvSocket::connect(&server.api(), "/ws").await;
    other.reset(json!({"seed": 1})).await;
    let before = server.resident_mib();
    let mut floods = Vec::new();
    for path in ["/ws", "/mcp", "/ws/ui"] {
        let stream = connect(server.address()).await;
        floods.push(tokio::task::spawn_blocking(move || send_pings(stream, path)));
    }
    let start = Instant::now();
    while start.elapsed() < FLOOD {
        let asked = Instant::now();
        other.step(json!({})).await;
        assert!(asked.elapsed() < Duration::from_secs(2), "another session waits: {:?}", asked.elapsed());
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    for flood in floods {
        assert!(flood.await.unwrap() > 100_000, "the server reads until its pongs fill the connection");
    }
    let growth = server.resident_mib().saturating_sub(before);
    assert!(growth < MAX_GROWTH_MIB, "the memory grew by {growth} MiB");
}

/// A server for trainers has the same limit before and after a session is open.
#[tokio::test(flavor = "multi_thread")]
async fn pings_to_v1_sessions_use_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let before = server.resident_mib();
    let stream = connect(server.address()).await;
    tokio::task::spawn_blocking(move || send_pings(stream, "/v1/sessions")).await.unwrap();
    let growth = server.resident_mib().saturating_sub(before);
    assert!(growth < MAX_GROWTH_MIB, "the memory grew by {growth} MiB");
}
