//! OpenEnv sessions over WebSockets: steps a second of the server's processor time, latency with many sessions, and memory
//! of an idle session. The server is a process of its own; clients share its machine. Messages are not compressed.

mod load;
pub(crate) mod process;

use std::time::Duration;

use system_tests::ServerProcess;

use self::load::Session;
use crate::Row;

/// Number of measurements of our server and of the peer, in turn; the best of each counts.
const TURNS: usize = 3;
const DURATION: Duration = Duration::from_secs(3);
/// Steps a second of each session when latency is measured.
const LATENCY_RATE: f64 = 20.0;
/// Number of sessions when latency is measured.
const LATENCY_SESSIONS: usize = 256;
/// Number of sessions whose memory is measured.
const IDLE_SESSIONS: usize = 2000;

/// Another OpenEnv server to compare with.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Peer {
    /// URL of another OpenEnv server for `sockets`, for example ws://127.0.0.1:8000/ws
    #[arg(long, requires = "peer_pid")]
    peer: Option<String>,
    /// Process id of that server
    #[arg(long, requires = "peer")]
    peer_pid: Option<u32>,
    /// Name of that server in the table
    #[arg(long, default_value = "peer")]
    peer_name: String,
}

pub(crate) fn measure(peer: &Peer) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(peer))
}

async fn run(peer: &Peer) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let options = ["--sessions", "100000", "--session-idle", "0"];
    let server = ServerProcess::start_with_options(&folder.path().join("bench.sqlite3"), &options);
    let url = format!("{}/ws", server.api().base().replacen("http", "ws", 1));
    let mut rows = Vec::new();
    for clients in [1, 32] {
        rows.extend(compare_rates(&url, server.pid(), clients, peer).await?);
    }
    rows.push(measure_latency(&url).await?);
    rows.push(measure_idle_memory(&url, server.pid()).await?);
    Ok(rows)
}

/// Measured speed of a server, in steps.
#[derive(Clone, Copy, Default)]
struct StepRate {
    per_cpu_s: f64,
    per_s: f64,
}

impl StepRate {
    fn best(self, other: Self) -> Self {
        if other.per_cpu_s > self.per_cpu_s { other } else { self }
    }

    fn describe(self) -> String {
        format!("{:.0}/CPU-s, {:.0}/s", self.per_cpu_s, self.per_s)
    }
}

async fn measure_rate(url: &str, pid: u32, clients: usize) -> anyhow::Result<StepRate> {
    let before = process::cpu_s(pid)?;
    let steps = load::step_at_full_speed(url, clients, DURATION).await? as f64;
    Ok(StepRate { per_cpu_s: steps / (process::cpu_s(pid)? - before), per_s: steps / DURATION.as_secs_f64() })
}

async fn compare_rates(url: &str, pid: u32, clients: usize, peer: &Peer) -> anyhow::Result<Vec<Row>> {
    let (mut ours, mut theirs) = (StepRate::default(), StepRate::default());
    for _ in 0..TURNS {
        ours = ours.best(measure_rate(url, pid, clients).await?);
        if let (Some(url), Some(pid)) = (&peer.peer, peer.peer_pid) {
            theirs = theirs.best(measure_rate(url, pid, clients).await?);
        }
    }
    let clients_label = if clients == 1 { "1 client".to_owned() } else { format!("{clients} clients") };
    let mut rows = vec![Row {
        label: format!("env-steps over WebSocket, {clients_label}"),
        measured: ours.describe(),
        goal: String::new(),
        ratio: None,
    }];
    if peer.peer.is_some() {
        let times = ours.per_cpu_s / theirs.per_cpu_s;
        rows.push(Row {
            label: format!("the same with {}, and our ratio to it per CPU-second", peer.peer_name),
            measured: format!("{}; {times:.1}×", theirs.describe()),
            goal: "≥ 20×".into(),
            ratio: Some(times / 20.0),
        });
    }
    Ok(rows)
}

async fn measure_latency(url: &str) -> anyhow::Result<Row> {
    let durations = load::step_at_rate(url, LATENCY_SESSIONS, LATENCY_RATE, Duration::from_secs(10)).await?;
    let at = |share: f64| {
        let index = ((durations.len() as f64 * share) as usize).min(durations.len().saturating_sub(1));
        durations.get(index).map_or(f64::NAN, |duration| duration.as_secs_f64() * 1e3)
    };
    let p99 = at(0.99);
    Ok(Row {
        label: format!(
            "step latency, {LATENCY_SESSIONS} sessions at {LATENCY_RATE} steps/s each ({} steps)",
            durations.len()
        ),
        measured: format!("{:.2} ms median, {p99:.2} p99", at(0.5)),
        goal: "p99 < 5 ms".into(),
        ratio: Some(5.0 / p99),
    })
}

/// Measures the memory of an idle session with an episode in progress.
async fn measure_idle_memory(url: &str, pid: u32) -> anyhow::Result<Row> {
    let mut sessions = Vec::new();
    // The first sessions allocate what all share.
    for _ in 0..50 {
        sessions.push(Session::open(url).await?);
    }
    let before = process::resident_bytes(pid)?;
    for _ in 0..IDLE_SESSIONS {
        sessions.push(Session::open(url).await?);
    }
    let each = (process::resident_bytes(pid)?.saturating_sub(before)) as f64 / IDLE_SESSIONS as f64 / 1024.0;
    Ok(Row {
        label: format!("memory of an idle session ({IDLE_SESSIONS} open, each with an episode)"),
        measured: format!("{each:.1} KiB"),
        goal: "< 64 KiB".into(),
        ratio: Some(64.0 / each),
    })
}
