//! WebSocket clients of an OpenEnv server with little work of their own, so that the server is measured.

use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use futures_util::{SinkExt, StreamExt};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

const RESET: &str = r#"{"type":"reset","data":{"task":"survival"}}"#;
/// Small burns of two satellites, so that episodes last and actions matter.
const STEP: &str = r#"{"type":"step","data":{"burns":[{"satellite_id":0,"delta_vx":0.01,"delta_vy":-0.02},{"satellite_id":1,"delta_vx":0.0,"delta_vy":0.015}]}}"#;

/// Session with an episode in progress.
pub(super) struct Session(WebSocketStream<MaybeTlsStream<TcpStream>>);

impl Session {
    /// Connects to `url`, for example `ws://127.0.0.1:8700/ws`, and starts an episode.
    pub(super) async fn open(url: &str) -> anyhow::Result<Self> {
        let mut session = Self(connect_async(url).await?.0);
        session.send_and_check_done(RESET).await?;
        Ok(session)
    }

    /// Sends a message and returns true if the episode is over.
    async fn send_and_check_done(&mut self, message: &'static str) -> anyhow::Result<bool> {
        self.0.send(Message::text(message)).await?;
        loop {
            match self.0.next().await.context("the server hung up")?? {
                Message::Text(text) => {
                    if !text.contains("\"type\":\"observation\"")
                        && !text.contains("\"type\": \"observation\"")
                    {
                        bail!("the server answered {}", text.chars().take(200).collect::<String>());
                    }
                    // The reply is not parsed, because that would load the client.
                    let end = &text[text.floor_char_boundary(text.len().saturating_sub(400))..];
                    return Ok(end.contains("\"done\":true") || end.contains("\"done\": true"));
                }
                Message::Close(_) => bail!("the server closed the session"),
                _ => {}
            }
        }
    }

    /// Steps, and starts a new episode if this one is over.
    pub(super) async fn step(&mut self) -> anyhow::Result<()> {
        if self.send_and_check_done(STEP).await? {
            self.send_and_check_done(RESET).await?;
        }
        Ok(())
    }
}

/// Steps `clients` sessions for `time`, each as fast as it gets replies; returns the number of steps.
pub(super) async fn step_at_full_speed(url: &str, clients: usize, time: Duration) -> anyhow::Result<u64> {
    let mut sessions = JoinSet::new();
    for _ in 0..clients {
        let mut session = Session::open(url).await?;
        sessions.spawn(async move {
            let (start, mut steps) = (Instant::now(), 0);
            while start.elapsed() < time {
                session.step().await?;
                steps += 1;
            }
            anyhow::Ok(steps)
        });
    }
    let mut steps = 0;
    while let Some(session) = sessions.join_next().await {
        steps += session??;
    }
    Ok(steps)
}

/// Steps `clients` sessions `rate` times a second each, spread evenly; returns the sorted durations of the steps.
pub(super) async fn step_at_rate(
    url: &str,
    clients: usize,
    rate: f64,
    time: Duration,
) -> anyhow::Result<Vec<Duration>> {
    let mut open = Vec::new();
    for _ in 0..clients {
        open.push(Session::open(url).await?);
    }
    let start = tokio::time::Instant::now() + Duration::from_millis(100);
    let mut sessions = JoinSet::new();
    for (number, mut session) in open.into_iter().enumerate() {
        sessions.spawn(async move {
            let offset = number as f64 / clients as f64;
            let mut durations = Vec::new();
            for index in 0.. {
                let due = Duration::from_secs_f64((f64::from(index) + offset) / rate);
                if due > time {
                    break;
                }
                tokio::time::sleep_until(start + due).await;
                // Measured from the send, because timers of this process fire up to a millisecond late.
                let sent = tokio::time::Instant::now();
                session.step().await?;
                durations.push(sent.elapsed());
            }
            anyhow::Ok(durations)
        });
    }
    let mut all = Vec::new();
    while let Some(session) = sessions.join_next().await {
        all.extend(session??);
    }
    all.sort_unstable();
    Ok(all)
}
