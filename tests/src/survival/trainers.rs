//! Trainers by every way in, each as patient as one should be: what nobody answers is asked again.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, ensure};
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;

use super::{Book, RUN};
use crate::{Answer, Api, Lease, result};

/// How long one waits before it asks again.
const WAIT: Duration = Duration::from_millis(30);
/// How often: longer than a server takes to start.
const TRIES: u32 = 1000;

pub(super) struct Trainer {
    api: Api,
    book: Arc<Book>,
    over: Arc<AtomicBool>,
    seed: u64,
}

impl Trainer {
    pub(super) fn new(api: &Api, book: &Arc<Book>, over: &Arc<AtomicBool>, seed: u64) -> Self {
        Self { api: api.clone(), book: Arc::clone(book), over: Arc::clone(over), seed }
    }

    fn goes_on(&self) -> bool {
        !self.over.load(Ordering::SeqCst)
    }

    /// Asks until somebody answers who is not busy.
    async fn ask(&self, method: &str, path: &str, body: &Value) -> anyhow::Result<Answer> {
        let path = format!("/v1/runs/{RUN}{path}");
        for _ in 0..TRIES {
            let body = if body.is_null() { String::new() } else { body.to_string() };
            match self.api.attempt(method, &path, "application/json", body).await {
                Ok(answer) if !matches!(answer.status, 429 | 503) => return Ok(answer),
                Ok(_) => {}
                Err(_) => self.book.away(),
            }
            tokio::time::sleep(WAIT).await;
        }
        anyhow::bail!("{method} {path}: nobody answers")
    }

    /// Leases groups, flies them here, and reports each result.
    pub(super) async fn results(self) -> anyhow::Result<()> {
        while self.goes_on() {
            let lease = self.ask("POST", "/leases", &json!({"groups": 3, "ttl_s": 60})).await?;
            ensure!(lease.status == 201, "no lease: {}", lease.body);
            let lease = Lease(lease.body);
            let episodes = lease.episodes();
            let results: Vec<Value> =
                episodes.iter().map(|(id, scenario)| result(id, scenario, "heuristic")).collect();
            for part in results.chunks(2) {
                self.report("results", part).await?;
            }
            // Leases go on: one that was taken from a server that is gone is renewed by the next, or was done.
            let renewed = self.ask("POST", &format!("/leases/{}/renew", lease.id()), &json!({})).await?;
            ensure!(
                renewed.status == 409 && renewed.body["detail"].to_string().contains("done"),
                "{}",
                renewed.body
            );
        }
        Ok(())
    }

    async fn report(&self, way: &'static str, results: &[Value]) -> anyhow::Result<()> {
        let told = self.ask("POST", "/results", &json!({"results": results})).await?;
        ensure!(told.status == 200, "not taken: {}", told.body);
        for receipt in told.body["results"].as_array().context("no receipts")? {
            self.book.receipt(way, receipt);
        }
        Ok(())
    }

    /// Leases ranges of seeds, claims scores, and sends the logs of what is audited.
    pub(super) async fn columns(self) -> anyhow::Result<()> {
        while self.goes_on() {
            let wish = json!({"groups": 24, "group_size": 1, "ttl_s": 60, "form": "columns"});
            let lease = self.ask("POST", "/leases", &wish).await?;
            ensure!(lease.status == 201, "no lease: {}", lease.body);
            let id = lease.body["lease"].as_str().context("no id")?.to_owned();
            let mut flown = Vec::new();
            for range in lease.body["ranges"].as_array().context("no ranges")? {
                for group in 0..range["groups"].as_u64().unwrap_or(0) {
                    let seed = range["seed"].as_u64().unwrap_or(0) + group;
                    let scenario =
                        Lease(lease.body.clone()).scenario(&json!({"recipe": range["recipe"], "seed": seed}));
                    flown.push((crate::flown(&scenario, "hold").0.score, scenario));
                }
            }
            let scores: Vec<f64> = flown.iter().map(|(score, _)| *score).collect();
            let path = format!("/leases/{id}/columns");
            let claim = self.ask("POST", &path, &json!({"score": scores})).await?;
            if claim.status == 409 {
                continue; // its time ran out while the server was away
            }
            ensure!(claim.status == 200, "not claimed: {}", claim.body);
            let groups = claim.body["audit"].as_array().context("no audit")?;
            let audited: Vec<&Value> =
                groups.iter().flat_map(|group| group["episodes"].as_array().into_iter().flatten()).collect();
            let index = |episode: &Value| -> anyhow::Result<usize> {
                Ok(episode.as_str().and_then(|id| id.rsplit('_').next()).context("no index")?.parse()?)
            };
            for part in audited.chunks(8) {
                let results = part
                    .iter()
                    .map(|id| Ok(result(id.as_str().unwrap_or_default(), &flown[index(id)?].1, "hold")));
                self.report("columns", &results.collect::<anyhow::Result<Vec<_>>>()?).await?;
            }
            let state = self.ask("GET", &path, &json!(null)).await?;
            match state.body["state"].as_str() {
                Some("accepted") => self.book.accepted(&id, flown.len() as u64),
                _ => self.book.fault(format!("columns of {id}: {}", state.body)),
            }
        }
        Ok(())
    }

    /// Steps episodes of the run on the server.
    pub(super) async fn steps(self) -> anyhow::Result<()> {
        let url = format!("{}/v1/sessions", self.api.base().replacen("http", "ws", 1));
        let mut id = self.seed << 32;
        while self.goes_on() {
            let Ok((mut socket, _)) = connect_async(&url).await else {
                self.book.away();
                tokio::time::sleep(WAIT).await;
                continue;
            };
            let mut message = json!({"type": "open", "version": 1, "run": RUN});
            while self.goes_on() {
                if socket.send(Message::text(message.to_string())).await.is_err() {
                    break;
                }
                let Some(Ok(Message::Text(text))) = socket.next().await else { break };
                let told: Value = serde_json::from_str(&text)?;
                if told["type"] == "error" {
                    break; // of what is told of an episode nothing counts but its receipt
                }
                if told["done"] == true {
                    self.book.receipt("steps", &told["reported"]);
                }
                id += 1;
                message = match told["done"] == true {
                    true => json!({"type": "reset", "id": id, "run": RUN}),
                    false => json!({"type": "step", "id": id, "action": {}}),
                };
            }
        }
        Ok(())
    }

    /// Pulls what the server flies, and acknowledges half of it.
    pub(super) async fn trajectories(self) -> anyhow::Result<()> {
        while self.goes_on() {
            let pulled = self.ask("GET", "/trajectories?limit=4&wait_s=1&ttl_s=2", &json!(null)).await?;
            ensure!(pulled.status == 200, "nothing pulled: {}", pulled.body);
            let groups = pulled.body["groups"].as_array().context("no groups")?;
            groups.iter().for_each(|group| self.book.delivered(group));
            let ids: Vec<i64> = groups.iter().filter_map(|group| group["id"].as_i64()).step_by(2).collect();
            if ids.is_empty() {
                continue;
            }
            let acked = self.ask("POST", "/trajectories/ack", &json!({"ids": ids})).await?;
            ensure!(acked.status == 200, "not acknowledged: {}", acked.body);
            self.book.acked(&ids);
        }
        Ok(())
    }
}

/// What is in the feed and not acknowledged, once nobody flies any more.
pub(super) async fn left(api: &Api, run: &str) -> anyhow::Result<Vec<Value>> {
    tokio::time::sleep(Duration::from_millis(2100)).await; // what was delivered and not acknowledged comes again
    let mut left = Vec::new();
    loop {
        let pulled = api.get(&format!("/v1/runs/{run}/trajectories?limit=64&ttl_s=600&wait_s=0")).await;
        ensure!(pulled.status == 200, "nothing pulled: {}", pulled.body);
        let groups = pulled.body["groups"].as_array().context("no groups")?;
        if groups.is_empty() {
            return Ok(left);
        }
        left.extend(groups.iter().cloned());
    }
}
