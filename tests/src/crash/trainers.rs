//! Trainers that use one interface each and retry every request that gets no response.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use serde_json::{Value, json};

use super::{AcknowledgementLog, CrashPlan, CrashWorld, RUN};
use crate::{ApiClient, ApiResponse, Lease, episode_result, run_policy, try_wait_for};

/// Pause between two attempts of a request.
pub(super) const RETRY_INTERVAL: Duration = Duration::from_millis(30);
/// Number of attempts: together longer than a server takes to start.
const MAX_ATTEMPTS: u32 = 1000;
/// Time after which the feed delivers an unacknowledged group again, in seconds.
const DELIVERY_TTL_S: u64 = 2;
/// Pause between two looks at a design request.
const DESIGN_INTERVAL: Duration = Duration::from_secs(2);
/// Lifetime of a lease of columns, and time for the logs of its claim.
const CLAIM_TTL: Duration = Duration::from_secs(60);
/// Number of episodes without a critique at which trainers of tasking wait, so that designs come while they train.
const MAX_WAITING_CRITIQUES: i64 = 100;

pub(super) struct Trainer {
    pub(super) api: ApiClient,
    pub(super) log: Arc<AcknowledgementLog>,
    stop: Arc<AtomicBool>,
    pub(super) world: CrashWorld,
    pub(super) seed: u64,
    /// Pause between two leases or episodes.
    pub(super) pause: Duration,
}

impl Trainer {
    pub(super) fn new(
        api: &ApiClient,
        log: &Arc<AcknowledgementLog>,
        stop: &Arc<AtomicBool>,
        plan: &CrashPlan,
        seed: u64,
    ) -> Self {
        let (world, pause) = (plan.world, Duration::from_millis(plan.trainer_pause_ms));
        Self { api: api.clone(), log: Arc::clone(log), stop: Arc::clone(stop), world, seed, pause }
    }

    pub(super) fn is_running(&self) -> bool {
        !self.stop.load(Ordering::SeqCst)
    }

    /// Returns whether the trainer goes on, after its pause. Trainers of tasking first wait until few episodes lack their critique.
    pub(super) async fn continues(&self) -> anyhow::Result<bool> {
        tokio::time::sleep(self.pause).await;
        while self.world == CrashWorld::Tasking && self.is_running() {
            let run = self.request("GET", "", &Value::Null).await?;
            ensure!(run.status == 200, "no run: {}", run.body);
            let waiting = run.body["critique_backlog"]["waiting"].as_i64().context("no critique backlog")?;
            if waiting <= MAX_WAITING_CRITIQUES {
                break;
            }
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
        Ok(self.is_running())
    }

    /// Sends a request until the server responds with anything but 429 or 503.
    pub(super) async fn request(
        &self,
        method: &str,
        path: &str,
        body: &Value,
    ) -> anyhow::Result<ApiResponse> {
        let path = format!("/v1/runs/{RUN}{path}");
        for _ in 0..MAX_ATTEMPTS {
            let body = if body.is_null() { String::new() } else { body.to_string() };
            match self.api.try_request(method, &path, "application/json", body).await {
                Ok(response) if !matches!(response.status, 429 | 503) => return Ok(response),
                Ok(_) => {}
                Err(_) => self.log.record_unreachable(),
            }
            tokio::time::sleep(RETRY_INTERVAL).await;
        }
        anyhow::bail!("{method} {path}: no response after {MAX_ATTEMPTS} attempts")
    }

    /// Leases groups of training, runs their episodes in this process and reports each result.
    pub(super) async fn report_results(self) -> anyhow::Result<()> {
        self.report_leases(json!({"groups": 3, "ttl_s": 600}), "heuristic").await
    }

    /// Leases probes and reports their results: those of the heuristic until each of `tasks` tasks has its first level, which is a
    /// middle one, then those of the reference planner, which masters levels.
    pub(super) async fn report_probes(self, tasks: usize) -> anyhow::Result<()> {
        let request = json!({"groups": 3, "ttl_s": 600, "purpose": "probe"});
        while self.continues().await? {
            let moves = self.request("GET", "/level_moves?limit=500", &Value::Null).await?;
            ensure!(moves.status == 200, "no level moves: {}", moves.body);
            let moves = moves.body["moves"].as_array().context("no level moves")?;
            let placed = moves.iter().filter(|level_move| level_move["kind"] == "placement").count();
            self.report_lease(&request, if placed < tasks { "heuristic" } else { "reference" }).await?;
        }
        Ok(())
    }

    /// Runs the episodes of one lease after the other with a built-in policy.
    async fn report_leases(self, request: Value, policy: &str) -> anyhow::Result<()> {
        while self.continues().await? {
            self.report_lease(&request, policy).await?;
        }
        Ok(())
    }

    /// Runs the episodes of a lease with a built-in policy.
    async fn report_lease(&self, request: &Value, policy: &str) -> anyhow::Result<()> {
        let response = self.request("POST", "/leases", request).await?;
        ensure!(response.status == 201, "no lease: {}", response.body);
        let lease = Lease(response.body);
        let episodes = lease.episodes();
        let results: Vec<Value> =
            episodes.iter().map(|(id, scenario)| episode_result(id, scenario, policy)).collect();
        for batch in results.chunks(2) {
            self.report("results", batch).await?;
        }
        // All results are in, so the lease is done, also after a restart: it cannot be renewed.
        let renewal = self.request("POST", &format!("/leases/{}/renew", lease.id()), &json!({})).await?;
        let is_done = renewal.status == 409 && renewal.body["detail"].to_string().contains("done");
        ensure!(is_done, "{}", renewal.body);
        Ok(())
    }

    /// Reports results. Returns true if one of them was late.
    async fn report(&self, interface: &'static str, results: &[Value]) -> anyhow::Result<bool> {
        let response = self.request("POST", "/results", &json!({"results": results})).await?;
        ensure!(response.status == 200, "results rejected: {}", response.body);
        let receipts = response.body["results"].as_array().context("no receipts")?;
        receipts.iter().for_each(|receipt| self.log.record_receipt(interface, receipt));
        Ok(receipts.iter().any(|receipt| receipt["status"] == "late"))
    }

    /// Leases ranges of seeds, and claims scores as columns.
    pub(super) async fn claim_columns(self) -> anyhow::Result<()> {
        while self.continues().await? {
            let ttl_s = CLAIM_TTL.as_secs();
            let request = json!({"groups": 24, "group_size": 1, "ttl_s": ttl_s, "form": "columns"});
            let leased_at = Instant::now();
            let response = self.request("POST", "/leases", &request).await?;
            ensure!(response.status == 201, "no lease: {}", response.body);
            let lease = Lease(response.body);
            let scenarios = column_scenarios(&lease)?;
            let policy = self.world.policies().columns;
            let scores: Vec<f64> =
                scenarios.iter().map(|scenario| run_policy(scenario, policy).outcome.score).collect();
            let path = format!("/leases/{}/columns", lease.id());
            let claimed_at = Instant::now();
            let claim = self.request("POST", &path, &json!({"score": scores})).await?;
            if claim.status == 409 && leased_at.elapsed() >= CLAIM_TTL {
                continue; // the lease expired
            }
            ensure!(claim.status == 200, "claim rejected: {}", claim.body);
            let is_late = self.send_audited_logs(&claim.body, &scenarios).await?;
            let status = self.request("GET", &path, &json!(null)).await?;
            match status.body["state"].as_str() {
                Some("accepted") => self.log.record_accepted_claim(lease.id(), scores.len() as u64),
                // On a busy machine logs can be late: the lease expired, and with it the claim, which counts for nothing. A claim whose
                // logs were all acknowledged in time must be accepted.
                Some("unproven") if is_late && claimed_at.elapsed() >= CLAIM_TTL => {}
                _ => self.log.record_fault(format!("columns of {}: {}", lease.id(), status.body)),
            }
        }
        Ok(())
    }

    /// Sends the logs of the audited episodes of a claim. Returns true if one of them was late.
    async fn send_audited_logs(
        &self,
        claim: &Value,
        scenarios: &[env_core::Scenario],
    ) -> anyhow::Result<bool> {
        let groups = claim["audited_groups"].as_array().context("no audit")?;
        let audited: Vec<&Value> =
            groups.iter().flat_map(|group| group["episodes"].as_array().into_iter().flatten()).collect();
        let index = |episode: &Value| -> anyhow::Result<usize> {
            Ok(episode.as_str().and_then(|id| id.rsplit('_').next()).context("no index")?.parse()?)
        };
        let mut is_late = false;
        for batch in audited.chunks(8) {
            let results = batch.iter().map(|id| {
                let scenario = &scenarios[index(id)?];
                Ok(episode_result(id.as_str().unwrap_or_default(), scenario, self.world.policies().columns))
            });
            is_late |= self.report("columns", &results.collect::<anyhow::Result<Vec<_>>>()?).await?;
        }
        Ok(is_late)
    }

    /// Requests layouts, one request after the other. A request ends, also if the server is killed meanwhile.
    pub(super) async fn request_designs(self) -> anyhow::Result<()> {
        while self.continues().await? {
            let wanted = json!({"count": 1, "designer": "procedural"});
            let asked = self.request("POST", "/designs", &wanted).await?;
            ensure!(asked.status == 202, "no design request: {}", asked.body);
            let path = format!("/designs/requests/{}", asked.body["id"].as_str().unwrap_or_default());
            let mut has_ended = false;
            while self.is_running() && !has_ended {
                tokio::time::sleep(DESIGN_INTERVAL).await;
                let design = self.request("GET", &path, &Value::Null).await?;
                ensure!(design.status == 200, "the design request is lost: {}", design.body);
                has_ended = design.body["ended_at"].is_string();
            }
        }
        Ok(())
    }

    /// Claims groups of server rollouts from the feed and acknowledges half of them.
    pub(super) async fn consume_trajectories(self) -> anyhow::Result<()> {
        let claim = json!({"limit": 4, "wait_s": 1, "ttl_s": DELIVERY_TTL_S});
        while self.continues().await? {
            let claimed = self.request("POST", "/trajectories/claim", &claim).await?;
            ensure!(claimed.status == 200, "no trajectories: {}", claimed.body);
            let groups = claimed.body["groups"].as_array().context("no groups")?;
            groups.iter().for_each(|group| self.log.record_delivery(group));
            let ids: Vec<i64> = groups.iter().filter_map(|group| group["id"].as_i64()).step_by(2).collect();
            if ids.is_empty() {
                continue;
            }
            let acked = self.request("POST", "/trajectories/ack", &json!({"ids": ids})).await?;
            ensure!(acked.status == 200, "acknowledgement rejected: {}", acked.body);
            self.log.record_acks(&ids);
        }
        Ok(())
    }
}

/// Returns the scenarios of a lease of columns in the order of its episodes.
fn column_scenarios(lease: &Lease) -> anyhow::Result<Vec<env_core::Scenario>> {
    let mut scenarios = Vec::new();
    for range in lease.0["ranges"].as_array().context("no ranges")? {
        for group in 0..range["groups"].as_u64().unwrap_or(0) {
            let seed = range["seed"].as_u64().unwrap_or(0) + group;
            scenarios.push(lease.scenario(&json!({"recipe": range["recipe"], "seed": seed})));
        }
    }
    Ok(scenarios)
}

/// Claims every group that is in the feed without an acknowledgement. Server rollouts must be off.
///
/// A group that was delivered to a trainer returns to the feed after its TTL, so this function claims until it has all.
pub(super) async fn drain_feed(api: &ApiClient, run: &str) -> anyhow::Result<Vec<Value>> {
    let mut groups = Vec::new();
    let drained =
        try_wait_for("every group without an acknowledgement is delivered", async || match claim_remaining(
            api,
            run,
            &mut groups,
        )
        .await
        {
            Ok(true) => Some(Ok(())),
            Ok(false) => None,
            Err(error) => Some(Err(error)),
        });
    drained.await??;
    Ok(groups)
}

/// Appends the groups that the feed delivers now; returns true if these are all groups without an acknowledgement.
async fn claim_remaining(api: &ApiClient, run: &str, groups: &mut Vec<Value>) -> anyhow::Result<bool> {
    let claim = json!({"limit": 64, "ttl_s": 600});
    let claimed = api.post(&format!("/v1/runs/{run}/trajectories/claim"), claim).await;
    ensure!(claimed.status == 200, "no trajectories: {}", claimed.body);
    groups.extend(claimed.body["groups"].as_array().context("no groups")?.iter().cloned());
    let feed = api.get(&format!("/v1/runs/{run}/policy")).await.body["feed"].clone();
    let count = |field: &str| feed[field].as_u64().with_context(|| format!("no number of {field} groups"));
    Ok(groups.len() as u64 == count("waiting")? + count("delivered")?)
}
