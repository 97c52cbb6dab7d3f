//! Clients of an OpenEnv server over WebSockets, as cheap as they can be: what is measured is the server.

use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use futures_util::{SinkExt, StreamExt};
use tokio::net::TcpStream;
use tokio::task::JoinSet;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

const RESET: &str = r#"{"type":"reset","data":{"task":"survival"}}"#;
/// Small burns of two satellites, so that episodes last and actions are read.
const STEP: &str = r#"{"type":"step","data":{"burns":[{"satellite_id":0,"delta_vx":0.01,"delta_vy":-0.02},{"satellite_id":1,"delta_vx":0.0,"delta_vy":0.015}]}}"#;

/// One session.
pub(super) struct Session(WebSocketStream<MaybeTlsStream<TcpStream>>);

impl Session {
    /// Opens one at `url`, as `ws://127.0.0.1:8700/ws`, and begins an episode.
    pub(super) async fn open(url: &str) -> anyhow::Result<Self> {
        let mut session = Self(connect_async(url).await?.0);
        session.ask(RESET).await?;
        Ok(session)
    }

    /// Asks; whether the episode is over.
    async fn ask(&mut self, message: &'static str) -> anyhow::Result<bool> {
        self.0.send(Message::text(message)).await?;
        loop {
            match self.0.next().await.context("the server hung up")?? {
                Message::Text(text) => {
                    if !text.contains("\"type\":\"observation\"")
                        && !text.contains("\"type\": \"observation\"")
                    {
                        bail!("the server answered {}", text.chars().take(200).collect::<String>());
                    }
                    // Not read further: that would be this program's work, not the server's.
                    let end = &text[text.floor_char_boundary(text.len().saturating_sub(400))..];
                    return Ok(end.contains("\"done\":true") || end.contains("\"done\": true"));
                }
                Message::Close(_) => bail!("the server closed the session"),
                _ => {}
            }
        }
    }

    /// Steps; where that ends the episode, another begins.
    pub(super) async fn step(&mut self) -> anyhow::Result<()> {
        if self.ask(STEP).await? {
            self.ask(RESET).await?;
        }
        Ok(())
    }
}

/// Steps so long with so many sessions, each as fast as it is answered; the steps taken.
pub(super) async fn as_fast_as_can_be(url: &str, clients: usize, time: Duration) -> anyhow::Result<u64> {
    let mut sessions = JoinSet::new();
    for _ in 0..clients {
        let mut session = Session::open(url).await?;
        sessions.spawn(async move {
            let (begun, mut steps) = (Instant::now(), 0);
            while begun.elapsed() < time {
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

/// Steps with so many sessions so often a second each, spread evenly; how long each step took, ascending. What comes later than
/// its turn because the last answer did counts from its turn.
pub(super) async fn in_turn(
    url: &str,
    clients: usize,
    rate: f64,
    time: Duration,
) -> anyhow::Result<Vec<Duration>> {
    let mut open = Vec::new();
    for _ in 0..clients {
        open.push(Session::open(url).await?);
    }
    let begun = tokio::time::Instant::now() + Duration::from_millis(100);
    let mut sessions = JoinSet::new();
    for (number, mut session) in open.into_iter().enumerate() {
        sessions.spawn(async move {
            let offset = number as f64 / clients as f64;
            let mut took = Vec::new();
            for turn in 0.. {
                let due = Duration::from_secs_f64((f64::from(turn) + offset) / rate);
                if due > time {
                    break;
                }
                tokio::time::sleep_until(begun + due).await;
                // Timers of this program wake a millisecond late: that is not the server's.
                let sent = tokio::time::Instant::now();
                session.step().await?;
                took.push(sent.elapsed());
            }
            anyhow::Ok(took)
        });
    }
    let mut all = Vec::new();
    while let Some(session) = sessions.join_next().await {
        all.extend(session??);
    }
    all.sort_unstable();
    Ok(all)
}
