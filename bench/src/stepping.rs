//! Vector sessions of `/v1/sessions` over loopback: environments stepped a second, the client included, the server in a process
//! of its own; its memory; and how long a lease takes meanwhile.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use system_tests::{Api, Process};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio_tungstenite::tungstenite::{Bytes, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async_with_config};

use crate::Row;
use crate::sockets::process;

/// Sessions, and environments of each: the best of these counts.
const SHAPES: [(usize, usize); 5] = [(1, 1024), (1, 4096), (2, 512), (2, 2048), (3, 1024)];
const SECONDS: Duration = Duration::from_secs(4);
const DEBRIS: u32 = 50;
/// What the trainer's side gives the frames of a session, in turn.
const VARIETY: usize = 8;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run())
}

/// A vector session, as cheap for the client as can be.
pub(crate) struct Session {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    frames: Vec<Vec<u8>>,
    sequence: u32,
    bytes: usize,
}

impl Session {
    pub(crate) async fn open(base: &str, envs: usize, seed: u64) -> anyhow::Result<Self> {
        let url = format!("{}/v1/sessions", base.replacen("http", "ws", 1));
        let (mut socket, _) = connect_async_with_config(url, None, true).await?;
        let wish = json!({"type": "open", "version": 1, "task": "survival", "params": {"debris": DEBRIS}, "seed": seed,
                          "vector": {"envs": envs, "observe": "tracks"}});
        socket.send(Message::text(wish.to_string())).await?;
        let Some(Ok(Message::Text(text))) = socket.next().await else { bail!("no answer") };
        let told: Value = serde_json::from_str(&text)?;
        anyhow::ensure!(told["type"] == "opened", "{told}");
        let size = |name: &str| told[name].as_u64().map(|n| n as usize).context("a size");
        let width = size("agents")? * size("action")?;
        let frame = |turn: usize| {
            let mut frame = b"SPVF\x01\0\x01\0\0\0\0\0".to_vec();
            frame.extend((envs as u32).to_le_bytes());
            // Small burns now and then, so that episodes last and actions are read.
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
        let mut session = Self { socket, frames: (0..VARIETY).map(frame).collect(), sequence: 0, bytes: 0 };
        session.bytes = session.answer().await?.len();
        Ok(session)
    }

    async fn answer(&mut self) -> anyhow::Result<Bytes> {
        match self.socket.next().await.context("the server hung up")?? {
            Message::Binary(bytes) => Ok(bytes),
            other => bail!("the server answered {other:?}"),
        }
    }

    pub(crate) async fn step(&mut self) -> anyhow::Result<()> {
        self.sequence += 1;
        let frame = &mut self.frames[self.sequence as usize % VARIETY];
        frame[8..12].copy_from_slice(&self.sequence.to_le_bytes());
        self.socket.send(Message::binary(frame.clone())).await?;
        let told = self.answer().await?;
        anyhow::ensure!(
            told.len() == self.bytes && told[8..12] == self.sequence.to_le_bytes(),
            "another answer"
        );
        Ok(())
    }
}

/// Environments stepped a second, and per second of the server's processor.
async fn rate(server: &Process, (sessions, envs): (usize, usize)) -> anyhow::Result<(f64, f64, usize)> {
    let mut open = JoinSet::new();
    let steps = Arc::new(AtomicU64::new(0));
    let mut bytes = 0;
    let mut all = Vec::new();
    for seed in 0..sessions {
        let mut session = Session::open(server.api().base(), envs, seed as u64).await?;
        // Memory grows in the first episodes.
        for _ in 0..60 {
            session.step().await?;
        }
        bytes = session.bytes;
        all.push(session);
    }
    let (cpu, begun) = (process::cpu_s(server.pid())?, Instant::now());
    for mut session in all {
        let steps = Arc::clone(&steps);
        open.spawn(async move {
            while begun.elapsed() < SECONDS {
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
    Ok((stepped / begun.elapsed().as_secs_f64(), stepped / (process::cpu_s(server.pid())? - cpu), bytes))
}

/// Takes leases of one group until told to stop: how long each took, ascending, milliseconds.
async fn leases(api: Api, stop: Arc<AtomicBool>) -> anyhow::Result<Vec<f64>> {
    let mut took = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        let begun = Instant::now();
        let answer = api.post("/v1/runs/bench/leases", json!({"groups": 1, "ttl_s": 60})).await;
        match answer.status {
            201 => {
                took.push(begun.elapsed().as_secs_f64() * 1e3);
                let path = format!(
                    "/v1/runs/bench/leases/{}/release",
                    answer.body["lease"].as_str().unwrap_or_default()
                );
                let _ = api.post(&path, json!({})).await;
            }
            429 | 503 => {}
            _ => bail!("no lease: {}", answer.body),
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    took.sort_by(f64::total_cmp);
    Ok(took)
}

async fn run() -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let server = Process::start(&folder.path().join("bench.sqlite3"));
    let mut rows = Vec::new();
    let (mut best, mut shape) = (0.0, SHAPES[0]);
    for (sessions, envs) in SHAPES {
        let (clock, cpu, bytes) = rate(&server, (sessions, envs)).await?;
        if clock > best {
            (best, shape) = (clock, (sessions, envs));
        }
        rows.push(Row {
            what: format!(
                "{sessions} × {envs} environments over WebSocket, tracks, {DEBRIS} debris, {} KiB a frame",
                bytes / 1024
            ),
            measured: format!("{clock:.0}/s, {cpu:.0}/CPU-s"),
            goal: String::new(),
            ratio: None,
        });
    }
    rows.push(Row {
        what: format!("env-steps a second of vector sessions, the best of these ({} × {})", shape.0, shape.1),
        measured: format!("{best:.0} steps/s"),
        goal: "≥ 300000 steps/s".into(),
        ratio: Some(best / 300_000.0),
    });
    rows.push(Row {
        what: "memory of the server after these".into(),
        measured: format!("{} MiB", process::resident(server.pid())? >> 20),
        goal: String::new(),
        ratio: None,
    });
    rows.push(meanwhile(&server, shape).await?);
    Ok(rows)
}

/// How long a lease takes while environments are stepped as fast as can be.
async fn meanwhile(server: &Process, shape: (usize, usize)) -> anyhow::Result<Row> {
    let api = server.api();
    let wish = json!({"id": "bench", "seed": 1, "placement": false, "design": {"designer": "off"}});
    let created = api.post("/v1/runs", wish).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    tokio::time::sleep(Duration::from_secs(2)).await; // scenarios are prepared
    let stop = Arc::new(AtomicBool::new(false));
    let taking = tokio::spawn(leases(api, Arc::clone(&stop)));
    let (clock, ..) = rate(server, shape).await?;
    stop.store(true, Ordering::Relaxed);
    let took = taking.await??;
    let at = |share: f64| took.get((took.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN);
    let p99 = at(0.99);
    Ok(Row {
        what: format!("a lease of one group while {clock:.0} steps/s are taken ({} leases)", took.len()),
        measured: format!("{:.1} ms median, {p99:.1} p99", at(0.5)),
        goal: "p99 < 20 ms".into(),
        ratio: Some(20.0 / p99),
    })
}
