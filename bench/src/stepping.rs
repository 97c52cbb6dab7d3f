//! Vector sessions of `/v1/sessions` over loopback: env-steps a second with the client included, memory of the server, and
//! latency of leases meanwhile. The server is a process of its own.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use system_tests::{ApiClient, ServerProcess};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio_tungstenite::tungstenite::{Bytes, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async_with_config};

use crate::Row;
use crate::sockets::process;

/// Number of sessions, and of environments of each.
#[derive(Clone, Copy)]
struct Shape {
    sessions: usize,
    envs: usize,
}

/// Measured shapes; the fastest one counts.
const SHAPES: [Shape; 5] = [
    Shape { sessions: 1, envs: 1024 },
    Shape { sessions: 1, envs: 4096 },
    Shape { sessions: 2, envs: 512 },
    Shape { sessions: 2, envs: 2048 },
    Shape { sessions: 3, envs: 1024 },
];
const DURATION: Duration = Duration::from_secs(4);

/// Episodes and observations of the environments.
#[derive(Clone, Copy)]
pub(crate) struct Workload {
    observe: &'static str,
    debris: u32,
    /// Goal, env-steps a second in the best shape.
    goal: f64,
}

pub(crate) const TRACKS: Workload = Workload { observe: "tracks", debris: 50, goal: 300_000.0 };
const ALL: Workload = Workload { observe: "all", debris: 25, goal: 1_000_000.0 };
/// Number of different action frames that a session sends in turn.
const ACTION_FRAMES: usize = 8;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run())
}

/// Vector session with little work for the client: frames are built in advance.
pub(crate) struct VectorSession {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    frames: Vec<Vec<u8>>,
    sequence: u32,
    bytes: usize,
}

impl VectorSession {
    pub(crate) async fn open(base: &str, workload: Workload, envs: usize, seed: u64) -> anyhow::Result<Self> {
        let Workload { observe, debris, .. } = workload;
        let url = format!("{}/v1/sessions", base.replacen("http", "ws", 1));
        let (mut socket, _) = connect_async_with_config(url, None, true).await?;
        let open_message = json!({"type": "open", "version": 2, "task": "survival", "params": {"debris": debris}, "seed": seed,
                          "vector": {"envs": envs, "observe": observe}});
        socket.send(Message::text(open_message.to_string())).await?;
        let Some(Ok(Message::Text(text))) = socket.next().await else { bail!("no answer") };
        let reply: Value = serde_json::from_str(&text)?;
        anyhow::ensure!(reply["type"] == "opened", "{reply}");
        let size = |name: &str| reply[name].as_u64().map(|n| n as usize).context("a size");
        let width = size("agents")? * size("action")?;
        let frame = |turn: usize| {
            let mut frame = b"SPVF\x02\0\x01\0\0\0\0\0".to_vec();
            frame.extend((envs as u32).to_le_bytes());
            // A small burn in each seventh value, so that episodes last and actions matter.
            let value = |cell: usize| {
                if (cell + turn).is_multiple_of(7) {
                    ((cell * 31 + turn) % 9) as f32 / 100.0 - 0.04
                } else {
                    0.0
                }
            };
            (0..envs * width).for_each(|cell| frame.extend(value(cell).to_le_bytes()));
            frame
        };
        let mut session =
            Self { socket, frames: (0..ACTION_FRAMES).map(frame).collect(), sequence: 0, bytes: 0 };
        session.bytes = session.receive_frame().await?.len();
        Ok(session)
    }

    async fn receive_frame(&mut self) -> anyhow::Result<Bytes> {
        match self.socket.next().await.context("the server hung up")?? {
            Message::Binary(bytes) => Ok(bytes),
            other => bail!("the server answered {other:?}"),
        }
    }

    pub(crate) async fn step(&mut self) -> anyhow::Result<()> {
        self.sequence += 1;
        let frame = &mut self.frames[self.sequence as usize % ACTION_FRAMES];
        frame[8..12].copy_from_slice(&self.sequence.to_le_bytes());
        self.socket.send(Message::binary(frame.clone())).await?;
        let reply = self.receive_frame().await?;
        anyhow::ensure!(
            reply.len() == self.bytes && reply[8..12] == self.sequence.to_le_bytes(),
            "another answer"
        );
        Ok(())
    }
}

/// Measured speed of a shape.
struct SteppingRate {
    /// Env-steps a second of elapsed time.
    per_s: f64,
    /// Env-steps a second of the server's processor time.
    per_cpu_s: f64,
    /// Size of a reply frame.
    frame_bytes: usize,
}

async fn measure_rate(
    server: &ServerProcess,
    workload: Workload,
    Shape { sessions, envs }: Shape,
) -> anyhow::Result<SteppingRate> {
    let mut open = JoinSet::new();
    let steps = Arc::new(AtomicU64::new(0));
    let mut bytes = 0;
    let mut all = Vec::new();
    for seed in 0..sessions {
        let mut session = VectorSession::open(server.api().base(), workload, envs, seed as u64).await?;
        // Warm-up: memory grows in the first episodes.
        for _ in 0..60 {
            session.step().await?;
        }
        bytes = session.bytes;
        all.push(session);
    }
    let (cpu, start) = (process::cpu_s(server.pid())?, Instant::now());
    for mut session in all {
        let steps = Arc::clone(&steps);
        open.spawn(async move {
            while start.elapsed() < DURATION {
                session.step().await?;
                steps.fetch_add(1, Ordering::Relaxed);
            }
            anyhow::Ok(())
        });
    }
    while let Some(done) = open.join_next().await {
        done??;
    }
    let stepped = steps.load(Ordering::Relaxed) as f64 * envs as f64;
    Ok(SteppingRate {
        per_s: stepped / start.elapsed().as_secs_f64(),
        per_cpu_s: stepped / (process::cpu_s(server.pid())? - cpu),
        frame_bytes: bytes,
    })
}

/// Leases one group at a time until `stop` is set; returns the sorted durations in milliseconds.
async fn lease_until_stopped(api: ApiClient, stop: Arc<AtomicBool>) -> anyhow::Result<Vec<f64>> {
    let mut durations = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        let start = Instant::now();
        let response = api.post("/v1/runs/bench/leases", json!({"groups": 1, "ttl_s": 60})).await;
        match response.status {
            201 => {
                durations.push(start.elapsed().as_secs_f64() * 1e3);
                let path = format!(
                    "/v1/runs/bench/leases/{}/release",
                    response.body["lease"].as_str().unwrap_or_default()
                );
                let _ = api.post(&path, json!({})).await;
            }
            429 | 503 => {}
            _ => bail!("no lease: {}", response.body),
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    durations.sort_by(f64::total_cmp);
    Ok(durations)
}

async fn run() -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let server = ServerProcess::start(&folder.path().join("bench.sqlite3"));
    let mut rows = Vec::new();
    measure_shapes(&server, ALL, &mut rows).await?;
    let shape = measure_shapes(&server, TRACKS, &mut rows).await?;
    rows.push(Row {
        label: "memory of the server after all shapes".into(),
        measured: format!("{} MiB", process::resident_bytes(server.pid())? >> 20),
        goal: String::new(),
        ratio: None,
    });
    rows.push(measure_lease_latency(&server, shape).await?);
    Ok(rows)
}

/// Measures a workload in all shapes, and returns the fastest one.
async fn measure_shapes(
    server: &ServerProcess,
    workload: Workload,
    rows: &mut Vec<Row>,
) -> anyhow::Result<Shape> {
    let Workload { observe, debris, goal } = workload;
    let (mut best, mut fastest) = (0.0, SHAPES[0]);
    for shape in SHAPES {
        let Shape { sessions, envs } = shape;
        let SteppingRate { per_s, per_cpu_s, frame_bytes } = measure_rate(server, workload, shape).await?;
        if per_s > best {
            (best, fastest) = (per_s, shape);
        }
        rows.push(Row {
            label: format!(
                "{sessions} × {envs} environments over WebSocket, {observe}, {debris} debris, {} KiB a frame",
                frame_bytes / 1024
            ),
            measured: format!("{per_s:.0}/s, {per_cpu_s:.0}/CPU-s"),
            goal: String::new(),
            ratio: None,
        });
    }
    rows.push(Row {
        label: format!(
            "env-steps a second of vector sessions, {observe}, best shape ({} × {})",
            fastest.sessions, fastest.envs
        ),
        measured: format!("{best:.0} steps/s"),
        goal: format!("≥ {goal:.0} steps/s"),
        ratio: Some(best / goal),
    });
    Ok(fastest)
}

/// Measures the latency of leases while environments step at full speed.
async fn measure_lease_latency(server: &ServerProcess, shape: Shape) -> anyhow::Result<Row> {
    let api = server.api();
    let open_message = json!({"id": "bench", "seed": 1, "placement": false, "design": {"designer": "off"}});
    let created = api.post("/v1/runs", open_message).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    // The server has prepared scenarios once it grants a lease, and offers those of a released lease again.
    let warm_up = api.lease("bench", json!({"groups": 64})).await;
    let released = api.post(&format!("/v1/runs/bench/leases/{}/release", warm_up.id()), json!({})).await;
    anyhow::ensure!(released.status == 200, "not released: {}", released.body);
    let stop = Arc::new(AtomicBool::new(false));
    let leasing = tokio::spawn(lease_until_stopped(api, Arc::clone(&stop)));
    let clock = measure_rate(server, TRACKS, shape).await?.per_s;
    stop.store(true, Ordering::Relaxed);
    let durations = leasing.await??;
    let at =
        |share: f64| durations.get((durations.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    let p99 = at(0.99);
    Ok(Row {
        label: format!("lease of one group at {clock:.0} env-steps/s ({} leases)", durations.len()),
        measured: format!("{:.1} ms median, {p99:.1} p99", at(0.5)),
        goal: "p99 < 20 ms".into(),
        ratio: Some(20.0 / p99),
    })
}
