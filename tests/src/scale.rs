//! Many runs and many slow clients, for the tests of scale and for the benchmarks that measure it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use anyhow::ensure;
use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::task::JoinSet;

use crate::ApiClient;

/// Clients that create runs at a time.
const CLIENTS: u32 = 8;
/// Runs that one request archives. Archived runs prepare no scenarios, which would take longer than the rest.
const ARCHIVED_AT_ONCE: usize = 16;
/// One run in so many stays active; the others are archived.
pub const ACTIVE_EVERY: u32 = 10;

/// Creates the runs `run-0` to `run-{runs - 1}`, and archives all but every tenth of them.
///
/// # Errors
/// Returns an error if the server rejects a request.
pub async fn create_runs(api: &ApiClient, runs: u32) -> anyhow::Result<()> {
    let mut clients = JoinSet::new();
    for client in 0..CLIENTS {
        clients.spawn(create_numbered(api.clone(), (client..runs).step_by(CLIENTS as usize).collect()));
    }
    while let Some(created) = clients.join_next().await {
        created??;
    }
    Ok(())
}

async fn create_numbered(api: ApiClient, numbers: Vec<u32>) -> anyhow::Result<()> {
    let mut finished = Vec::new();
    for number in numbers {
        let id = format!("run-{number}");
        let settings = json!({"strategy": "ladder", "id": id, "tasks": ["kessler/survival"], "design": {"designer": "off"}});
        let created = api.post("/v1/runs", settings).await;
        ensure!(created.status == 201, "no run: {}", created.body);
        if number % ACTIVE_EVERY != 0 {
            finished.push(id);
        }
        if finished.len() == ARCHIVED_AT_ONCE {
            archive(&api, &std::mem::take(&mut finished)).await?;
        }
    }
    match finished.is_empty() {
        true => Ok(()),
        false => archive(&api, &finished).await,
    }
}

async fn archive(api: &ApiClient, runs: &[String]) -> anyhow::Result<()> {
    let archived = api.post("/v1/archive", json!({"runs": runs})).await;
    ensure!(archived.status == 200, "not archived: {}", archived.body);
    Ok(())
}

/// Sends the head of a request, one byte a second, on a new connection whenever the server closes the last one. Runs until it is
/// aborted. Counts the connections that it opened, and those that the server closed.
pub async fn send_slowly(address: String, opened: &AtomicU64, closed: &AtomicU64) {
    loop {
        let Ok(mut stream) = TcpStream::connect(&address).await else {
            tokio::time::sleep(Duration::from_secs(1)).await;
            continue;
        };
        if stream.write_all(b"GET /livez HTTP/1.1\r\nHost: localhost\r\nX-Slow: ").await.is_err() {
            continue;
        }
        opened.fetch_add(1, Ordering::Relaxed);
        let mut buffer = [0; 256];
        loop {
            tokio::select! {
                read = stream.read(&mut buffer) => {
                    if read.is_ok_and(|bytes| bytes > 0) { continue }
                    closed.fetch_add(1, Ordering::Relaxed);
                    break;
                }
                () = tokio::time::sleep(Duration::from_secs(1)) => {
                    if stream.write_all(b"a").await.is_err() { break }
                }
            }
        }
    }
}
