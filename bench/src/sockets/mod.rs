//! OpenEnv sessions over WebSockets: steps a second of the server's processor time, how long a step takes while many fly, and
//! what an idle session weighs. The server is a process of its own; clients share the machine with it. Messages are not
//! compressed.

mod load;
pub(crate) mod process;

use std::time::Duration;

use system_tests::Process;

use self::load::Session;
use crate::Row;

/// Turns of ours and a peer's; the best of each counts.
const TURNS: usize = 3;
const SECONDS: Duration = Duration::from_secs(3);
/// Steps a second of each session in the measure of latency.
const RATE: f64 = 20.0;
const MANY: usize = 256;
/// Sessions whose memory is measured.
const IDLE: usize = 2000;

/// Another server that is measured beside ours.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Peer {
    /// `sockets` beside another OpenEnv server, as ws://127.0.0.1:8000/ws
    #[arg(long, requires = "peer_pid")]
    peer: Option<String>,
    /// The process of that server
    #[arg(long, requires = "peer")]
    peer_pid: Option<u32>,
    /// What to call it
    #[arg(long, default_value = "peer")]
    peer_name: String,
}

pub(crate) fn measure(peer: &Peer) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(peer))
}

async fn run(peer: &Peer) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let options = ["--sessions", "100000", "--session-idle", "0"];
    let server = Process::start_with(&folder.path().join("bench.sqlite3"), &options);
    let url = format!("{}/ws", server.api().base().replacen("http", "ws", 1));
    let mut rows = Vec::new();
    for clients in [1, 32] {
        rows.extend(rates(&url, server.pid(), clients, peer).await?);
    }
    rows.push(latency(&url).await?);
    rows.push(weight(&url, server.pid()).await?);
    Ok(rows)
}

/// Steps a second of the server's processor time, and of the clock.
async fn rate(url: &str, pid: u32, clients: usize) -> anyhow::Result<(f64, f64)> {
    let before = process::cpu_s(pid)?;
    let steps = load::as_fast_as_can_be(url, clients, SECONDS).await? as f64;
    Ok((steps / (process::cpu_s(pid)? - before), steps / SECONDS.as_secs_f64()))
}

async fn rates(url: &str, pid: u32, clients: usize, peer: &Peer) -> anyhow::Result<Vec<Row>> {
    let (mut ours, mut theirs) = ((0.0_f64, 0.0_f64), (0.0_f64, 0.0_f64));
    let best = |best: (f64, f64), now: (f64, f64)| if now.0 > best.0 { now } else { best };
    for _ in 0..TURNS {
        ours = best(ours, rate(url, pid, clients).await?);
        if let (Some(url), Some(pid)) = (&peer.peer, peer.peer_pid) {
            theirs = best(theirs, rate(url, pid, clients).await?);
        }
    }
    let of = if clients == 1 { "1 client".to_owned() } else { format!("{clients} clients") };
    let told = |(cpu, clock): (f64, f64)| format!("{cpu:.0}/CPU-s, {clock:.0}/s");
    let mut rows = vec![Row {
        what: format!("env-steps over WebSocket, {of}"),
        measured: told(ours),
        goal: String::new(),
        ratio: None,
    }];
    if peer.peer.is_some() {
        let times = ours.0 / theirs.0;
        rows.push(Row {
            what: format!("the same of {}, and ours to it per CPU-second", peer.peer_name),
            measured: format!("{}; {times:.1}×", told(theirs)),
            goal: "≥ 20×".into(),
            ratio: Some(times / 20.0),
        });
    }
    Ok(rows)
}

async fn latency(url: &str) -> anyhow::Result<Row> {
    let took = load::in_turn(url, MANY, RATE, Duration::from_secs(10)).await?;
    let at = |share: f64| {
        let index = ((took.len() as f64 * share) as usize).min(took.len().saturating_sub(1));
        took.get(index).map_or(f64::NAN, |took| took.as_secs_f64() * 1e3)
    };
    let p99 = at(0.99);
    Ok(Row {
        what: format!("a step, {MANY} sessions at {RATE} steps/s each ({} steps)", took.len()),
        measured: format!("{:.2} ms median, {p99:.2} p99", at(0.5)),
        goal: "p99 < 5 ms".into(),
        ratio: Some(5.0 / p99),
    })
}

/// Memory of a session in which an episode was begun and nothing is asked.
async fn weight(url: &str, pid: u32) -> anyhow::Result<Row> {
    let mut sessions = Vec::new();
    // The first ones pay for what is there once.
    for _ in 0..50 {
        sessions.push(Session::open(url).await?);
    }
    let before = process::resident(pid)?;
    for _ in 0..IDLE {
        sessions.push(Session::open(url).await?);
    }
    let each = (process::resident(pid)?.saturating_sub(before)) as f64 / IDLE as f64 / 1024.0;
    Ok(Row {
        what: format!("memory of an idle session ({IDLE} open, each with an episode begun)"),
        measured: format!("{each:.1} KiB"),
        goal: "< 64 KiB".into(),
        ratio: Some(64.0 / each),
    })
}
