//! Record of what the server acknowledged to the trainers, and its comparison with the database.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::ensure;
use serde_json::Value;

use super::CurriculumProgress;
use super::processes::ServerExits;

/// Everything that trainers received an acknowledgement for. All trainers share one log.
#[derive(Debug, Default)]
pub struct AcknowledgementLog(Mutex<Acknowledgements>);

#[derive(Debug, Default)]
struct Acknowledgements {
    /// Acknowledged results by episode id.
    results: BTreeMap<String, AcknowledgedResult>,
    /// Number of results that were sent again and acknowledged as duplicates.
    repeated: u64,
    /// Number of episodes of each lease whose column claim was accepted.
    columns: BTreeMap<String, u64>,
    /// Groups that the trajectory feed delivered, by group id.
    delivered: BTreeMap<i64, Vec<EpisodeScore>>,
    /// Ids of delivered groups whose acknowledgement the server confirmed.
    acknowledged: BTreeSet<i64>,
    /// Largest number of episodes of each lease that a vector session said were stored.
    vectors: BTreeMap<String, u64>,
    /// Number of sessions that were resumed after a lost connection.
    resumed: u64,
    /// Number of requests that found no server.
    unreachable: u64,
    /// Violations that were seen during the test.
    faults: Vec<String>,
}

#[derive(Debug, Clone, Copy)]
struct AcknowledgedResult {
    /// Interface that the trainer used: `results`, `columns`, `steps` or `trajectories`.
    interface: &'static str,
    score: f64,
}

#[derive(Debug, Clone, PartialEq)]
struct EpisodeScore {
    id: String,
    score: f64,
}

/// State of the server after the last restart.
pub(super) struct ServerState {
    /// All episodes of the run.
    pub episodes: Vec<Value>,
    /// Response of the mastery endpoint.
    pub mastery: Value,
    /// Groups that are still in the trajectory feed.
    pub undelivered: Vec<Value>,
    /// Actions of the curriculum of the run.
    pub progress: CurriculumProgress,
}

impl AcknowledgementLog {
    fn lock(&self) -> MutexGuard<'_, Acknowledgements> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn record_unreachable(&self) {
        self.lock().unreachable += 1;
    }

    pub(super) fn record_fault(&self, message: String) {
        self.lock().faults.push(message);
    }

    /// Records a receipt if it acknowledges a result. Any other receipt but `late` and `lost` is a fault.
    pub(super) fn record_receipt(&self, interface: &'static str, receipt: &Value) {
        let mut log = self.lock();
        let (status, episode) =
            (receipt["status"].as_str().unwrap_or(""), receipt["episode"].as_str().unwrap_or(""));
        let score = receipt["score"].as_f64();
        match (status, score) {
            ("counted" | "stored" | "duplicate" | "audited", Some(score)) => {
                log.repeated += u64::from(status == "duplicate");
                let result = AcknowledgedResult { interface, score };
                let before = log.results.insert(episode.to_owned(), result);
                if let Some(before) = before.filter(|before| before.score.to_bits() != score.to_bits()) {
                    log.faults
                        .push(format!("{episode} was acknowledged with {}, then with {score}", before.score));
                }
            }
            // The lease expired while the server was down.
            ("late" | "lost", _) => {}
            _ => log.faults.push(format!("{interface}: {receipt}")),
        }
    }

    pub(super) fn record_accepted_claim(&self, lease: &str, episodes: u64) {
        self.lock().columns.insert(lease.to_owned(), episodes);
    }

    /// Records a delivered group. A second delivery after the acknowledgement, or with other episodes, is a fault.
    pub(super) fn record_delivery(&self, group: &Value) {
        let id = group["id"].as_i64().unwrap_or(-1);
        let episodes = group["episodes"].as_array().into_iter().flatten();
        let episodes: Vec<EpisodeScore> = episodes
            .map(|episode| EpisodeScore {
                id: episode["id"].as_str().unwrap_or("").to_owned(),
                score: episode["score"].as_f64().unwrap_or(f64::NAN),
            })
            .collect();
        let mut log = self.lock();
        if log.acknowledged.contains(&id) {
            log.faults.push(format!("group {id} was delivered again after its acknowledgement"));
        }
        if log.delivered.insert(id, episodes.clone()).is_some_and(|before| before != episodes) {
            log.faults.push(format!("group {id} was delivered again with other episodes"));
        }
    }

    /// Records how many episodes of a lease a vector session has reported.
    pub(super) fn record_vector(&self, lease: &str, reported: u64) {
        let mut log = self.lock();
        let known = log.vectors.entry(lease.to_owned()).or_default();
        *known = reported.max(*known);
    }

    pub(super) fn record_resumed(&self) {
        self.lock().resumed += 1;
    }

    pub(super) fn record_acks(&self, ids: &[i64]) {
        self.lock().acknowledged.extend(ids);
    }

    /// Returns the number of acknowledged or delivered episodes of the interface that has the fewest.
    pub(super) fn fewest_episodes(&self) -> usize {
        let log = self.lock();
        let reported =
            |interface| log.results.values().filter(|result| result.interface == interface).count();
        let delivered: usize = log.delivered.values().map(Vec::len).sum();
        let vectors = usize::try_from(log.vectors.values().sum::<u64>()).unwrap_or(usize::MAX);
        ["results", "columns", "steps"].map(reported).into_iter().fold(delivered.min(vectors), usize::min)
    }

    pub(super) fn summary_line(&self) -> String {
        let log = self.lock();
        format!(
            "{} results acknowledged, {} claims, {} groups delivered, {} faults",
            log.results.len(),
            log.columns.len(),
            log.delivered.len(),
            log.faults.len()
        )
    }

    /// Compares the log with the state of the server, and fails if an acknowledged result is lost or counted twice.
    pub(super) fn compare(&self, exits: ServerExits, state: &ServerState) -> anyhow::Result<CrashReport> {
        state.undelivered.iter().for_each(|group| self.record_delivery(group));
        let log = self.lock();
        let mut faults = log.faults.clone();
        let stored = index_by_id(&state.episodes, &mut faults);
        let by_interface = log.check_episodes(&stored, &mut faults);
        log.check_vectors(&stored, &mut faults);
        let sum = |field: &str, part: &str| -> u64 {
            let tasks = state.mastery["tasks"].as_array().into_iter().flatten();
            tasks.map(|task| task[field][part].as_u64().unwrap_or(0)).sum()
        };
        let finished = state.episodes.iter().filter(|episode| episode["state"] == "finished").count() as u64;
        // Logs of a claim that never became complete are stored, but count for nothing.
        let counted = sum("results", "episodes") + sum("designed_results", "episodes");
        let (claimed, accepted) = (sum("claimed_results", "episodes"), log.columns.values().sum::<u64>());
        if counted > finished {
            faults.push(format!("{counted} episodes are counted, but only {finished} are stored"));
        }
        if claimed < accepted {
            faults.push(format!(
                "{accepted} episodes of columns were accepted, but only {claimed} are counted"
            ));
        }
        let report = CrashReport {
            kills: exits.kills,
            stops: exits.stops,
            worker_kills: exits.remote.workers,
            nats_kills: exits.remote.nats,
            remote_jobs: exits.remote.jobs,
            remote_designs: exits.remote.designs,
            remote_rollouts: exits.remote.rollouts,
            elapsed_s: 0,
            is_interrupted: false,
            unreachable: log.unreachable,
            resumed: log.resumed,
            vectors: log.vectors.values().sum::<u64>(),
            by_interface,
            repeated: log.repeated,
            finished,
            counted,
            accepted,
            claimed,
            groups: log.delivered.len() as u64,
            acknowledged: log.acknowledged.len() as u64,
            progress: state.progress,
        };
        ensure!(faults.is_empty(), "{report}\n{} faults:\n{}", faults.len(), faults.join("\n"));
        Ok(report)
    }
}

impl Acknowledgements {
    /// Checks that each lease has as many finished episodes as its vector session reported.
    fn check_vectors(&self, stored: &BTreeMap<&str, &Value>, faults: &mut Vec<String>) {
        let mut finished: BTreeMap<&str, u64> = BTreeMap::new();
        for (id, episode) in stored {
            let lease =
                id.strip_prefix("ep_").and_then(|rest| rest.rsplit_once('_')).map_or("", |(lease, _)| lease);
            *finished.entry(lease).or_default() += u64::from(episode["state"] == "finished");
        }
        for (lease, reported) in &self.vectors {
            let found = finished.get(lease.as_str()).copied().unwrap_or(0);
            if found < *reported {
                faults.push(format!(
                    "{reported} episodes of {lease} were reported by frames, {found} are stored"
                ));
            }
        }
    }

    /// Checks that each acknowledged episode is stored with the same score, and counts the episodes by interface.
    fn check_episodes(
        &self,
        stored: &BTreeMap<&str, &Value>,
        faults: &mut Vec<String>,
    ) -> BTreeMap<&'static str, u64> {
        let mut by_interface: BTreeMap<&'static str, u64> = BTreeMap::new();
        let reported = self.results.iter().map(|(id, result)| (id.as_str(), *result));
        let delivered = self.delivered.values().flatten().map(|episode| {
            (episode.id.as_str(), AcknowledgedResult { interface: "trajectories", score: episode.score })
        });
        for (id, result) in reported.chain(delivered) {
            *by_interface.entry(result.interface).or_default() += 1;
            let found = stored.get(id);
            let is_same = found.is_some_and(|episode| {
                episode["state"] == "finished"
                    && episode["score"].as_f64().map(f64::to_bits) == Some(result.score.to_bits())
            });
            if !is_same {
                faults.push(format!("{id} was acknowledged with {}, stored is {found:?}", result.score));
            }
        }
        by_interface
    }
}

fn index_by_id<'a>(episodes: &'a [Value], faults: &mut Vec<String>) -> BTreeMap<&'a str, &'a Value> {
    let mut stored: BTreeMap<&str, &Value> = BTreeMap::new();
    for episode in episodes {
        let id = episode["episode"].as_str().unwrap_or("");
        if stored.insert(id, episode).is_some() {
            faults.push(format!("{id} is stored twice"));
        }
    }
    stored
}

/// Counts of a crash test that found no fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CrashReport {
    /// Number of servers that were killed with SIGKILL.
    pub kills: u32,
    /// Number of servers that were stopped with SIGTERM.
    pub stops: u32,
    /// Number of workers on NATS that were killed.
    pub worker_kills: u32,
    /// Number of NATS servers that were killed.
    pub nats_kills: u32,
    /// Number of jobs whose results came from workers.
    pub remote_jobs: u64,
    /// Number of these jobs that designed layouts.
    pub remote_designs: u64,
    /// Number of these jobs that rolled out policies.
    pub remote_rollouts: u64,
    /// Duration until the last kill, in seconds.
    pub elapsed_s: u64,
    /// True if a signal ended the test early.
    pub is_interrupted: bool,
    /// Number of requests that found no server.
    pub unreachable: u64,
    /// Number of sessions that were resumed after a lost connection.
    pub resumed: u64,
    /// Number of episodes that vector sessions said were stored; all are.
    pub vectors: u64,
    /// Number of acknowledged episodes by interface; each of them is stored with the acknowledged score.
    pub by_interface: BTreeMap<&'static str, u64>,
    /// Number of results that were sent again and acknowledged as duplicates.
    pub repeated: u64,
    /// Number of finished episodes in the database.
    pub finished: u64,
    /// Number of episodes that count for mastery.
    pub counted: u64,
    /// Number of episodes in column claims that were accepted, as trainers know it.
    pub accepted: u64,
    /// Number of episodes of column claims that count for mastery.
    pub claimed: u64,
    /// Number of groups that the trajectory feed delivered.
    pub groups: u64,
    /// Number of delivered groups that were acknowledged; none was delivered again.
    pub acknowledged: u64,
    /// Actions of the curriculum of the run.
    pub progress: CurriculumProgress,
}

impl fmt::Display for CrashReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<52} {:>9}", "servers killed (SIGKILL)", self.kills)?;
        writeln!(f, "{:<52} {:>9}", "servers stopped (SIGTERM)", self.stops)?;
        if self.worker_kills > 0 {
            writeln!(f, "{:<52} {:>9}", "workers killed (SIGKILL)", self.worker_kills)?;
            writeln!(f, "{:<52} {:>9}", "NATS servers killed (SIGKILL)", self.nats_kills)?;
            writeln!(f, "{:<52} {:>9}", "jobs that workers did", self.remote_jobs)?;
            writeln!(f, "{:<52} {:>9}", "of these, designs", self.remote_designs)?;
            writeln!(f, "{:<52} {:>9}", "of these, rollouts", self.remote_rollouts)?;
        }
        writeln!(f, "{:<52} {:>9}", "requests without a response, sent again", self.unreachable)?;
        writeln!(f, "{:<52} {:>9}", "sessions resumed after a lost connection", self.resumed)?;
        writeln!(f, "{:<52} {:>9}", "episodes acknowledged by binary frames, all stored", self.vectors)?;
        for (interface, episodes) in &self.by_interface {
            let line = format!("episodes acknowledged by {interface}, all stored");
            writeln!(f, "{line:<52} {episodes:>9}")?;
        }
        writeln!(f, "{:<52} {:>9}", "results sent again, acknowledged as before", self.repeated)?;
        writeln!(f, "{:<52} {:>9}", "finished episodes in the database", self.finished)?;
        writeln!(f, "{:<52} {:>9}", "of these, counted episodes (each once)", self.counted)?;
        writeln!(f, "{:<52} {:>9}", "episodes of columns that trainers saw accepted", self.accepted)?;
        writeln!(f, "{:<52} {:>9}", "episodes of columns that count", self.claimed)?;
        writeln!(f, "{:<52} {:>9}", "groups delivered by the feed", self.groups)?;
        writeln!(f, "{:<52} {:>9}", "groups acknowledged, none delivered again", self.acknowledged)?;
        write!(f, "{}", self.progress)
    }
}
