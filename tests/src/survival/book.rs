//! What trainers were told, and what there is of it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::ensure;
use serde_json::Value;

/// What trainers were told.
#[derive(Debug, Default)]
pub struct Book(Mutex<Told>);

#[derive(Debug, Default)]
struct Told {
    /// Scores of episodes whose results were acknowledged, by the way in they came by.
    results: BTreeMap<String, (&'static str, f64)>,
    /// Results that were sent again, and answered as before.
    repeated: u64,
    /// Columns that were accepted: their leases, with how many episodes.
    columns: BTreeMap<String, u64>,
    /// Groups that were delivered, with their episodes and scores.
    delivered: BTreeMap<i64, Vec<(String, f64)>>,
    /// Of these, those whose acknowledgement was answered.
    acked: BTreeSet<i64>,
    /// Times that the server was away.
    away: u64,
    /// What must not be.
    faults: Vec<String>,
}

impl Book {
    fn told(&self) -> MutexGuard<'_, Told> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn away(&self) {
        self.told().away += 1;
    }

    pub(super) fn fault(&self, words: String) {
        self.told().faults.push(words);
    }

    /// A receipt: what of it is an acknowledgement is noted.
    pub(super) fn receipt(&self, way: &'static str, receipt: &Value) {
        let mut told = self.told();
        let (status, episode) =
            (receipt["status"].as_str().unwrap_or(""), receipt["episode"].as_str().unwrap_or(""));
        let score = receipt["score"].as_f64();
        match (status, score) {
            ("counted" | "stored" | "duplicate" | "audited", Some(score)) => {
                told.repeated += u64::from(status == "duplicate");
                let before = told.results.insert(episode.to_owned(), (way, score));
                if before.is_some_and(|(_, before)| before.to_bits() != score.to_bits()) {
                    told.faults.push(format!("{episode} was told {before:?}, then {score}"));
                }
            }
            // Its lease ended while the server was away.
            ("late" | "lost", _) => {}
            _ => told.faults.push(format!("{way}: {receipt}")),
        }
    }

    pub(super) fn accepted(&self, lease: &str, episodes: u64) {
        self.told().columns.insert(lease.to_owned(), episodes);
    }

    /// A group that was delivered; one that was acknowledged must not come again.
    pub(super) fn delivered(&self, group: &Value) {
        let id = group["id"].as_i64().unwrap_or(-1);
        let episodes = group["episodes"].as_array().into_iter().flatten();
        let episodes: Vec<(String, f64)> = episodes
            .map(|episode| {
                (
                    episode["id"].as_str().unwrap_or("").to_owned(),
                    episode["score"].as_f64().unwrap_or(f64::NAN),
                )
            })
            .collect();
        let mut told = self.told();
        if told.acked.contains(&id) {
            told.faults.push(format!("group {id} came again after it was acknowledged"));
        }
        if told.delivered.insert(id, episodes.clone()).is_some_and(|before| before != episodes) {
            told.faults.push(format!("group {id} came again, and another one"));
        }
    }

    pub(super) fn acked(&self, ids: &[i64]) {
        self.told().acked.extend(ids);
    }

    pub(super) fn in_a_line(&self) -> String {
        let told = self.told();
        format!(
            "{} results acknowledged, {} claims, {} groups delivered, {} faults",
            told.results.len(),
            told.columns.len(),
            told.delivered.len(),
            told.faults.len()
        )
    }

    /// Compares it with what there is: the run's episodes, its mastery, and the groups that nobody acknowledged.
    pub(super) fn compare(
        &self,
        (kills, stops): (u32, u32),
        episodes: &[Value],
        mastery: &Value,
        left: &[Value],
    ) -> anyhow::Result<Ledger> {
        left.iter().for_each(|group| self.delivered(group));
        let told = self.told();
        let mut faults = told.faults.clone();
        let mut there: BTreeMap<&str, &Value> = BTreeMap::new();
        for episode in episodes {
            let id = episode["episode"].as_str().unwrap_or("");
            if there.insert(id, episode).is_some() {
                faults.push(format!("{id} is there twice"));
            }
        }
        let mut by_way: BTreeMap<&'static str, u64> = BTreeMap::new();
        let delivered = told.delivered.values().flatten().map(|(id, score)| (id, ("trajectories", *score)));
        for (id, (way, score)) in told.results.iter().map(|(id, told)| (id, *told)).chain(delivered) {
            *by_way.entry(way).or_default() += 1;
            let same = there.get(id.as_str()).is_some_and(|episode| {
                episode["state"] == "finished"
                    && episode["score"].as_f64().map(f64::to_bits) == Some(score.to_bits())
            });
            if !same {
                faults.push(format!(
                    "{id} was acknowledged with {score}, and there is {:?}",
                    there.get(id.as_str())
                ));
            }
        }
        let sum = |field: &str, part: &str| -> u64 {
            let tasks = mastery["tasks"].as_array().into_iter().flatten();
            tasks.map(|task| task[field][part].as_u64().unwrap_or(0)).sum()
        };
        let finished = episodes.iter().filter(|episode| episode["state"] == "finished").count() as u64;
        // Logs of a claim whose last one never came are there and count for nothing.
        let counted = sum("plain", "episodes") + sum("designed", "episodes");
        let (claimed, accepted) = (sum("claimed", "episodes"), told.columns.values().sum::<u64>());
        if counted > finished {
            faults.push(format!("{counted} episodes count, and {finished} are there"));
        }
        if claimed < accepted {
            faults.push(format!("{accepted} episodes were accepted in columns, and {claimed} count"));
        }
        let ledger = Ledger {
            kills,
            stops,
            away: told.away,
            by_way,
            repeated: told.repeated,
            finished,
            counted,
            accepted,
            claimed,
            groups: told.delivered.len() as u64,
            acked: told.acked.len() as u64,
        };
        ensure!(faults.is_empty(), "{ledger}\n{} faults:\n{}", faults.len(), faults.join("\n"));
        Ok(ledger)
    }
}

/// What came of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ledger {
    /// Times that a server was killed (−9).
    pub kills: u32,
    /// Times that one was asked to stop (SIGTERM).
    pub stops: u32,
    /// Requests that nobody answered.
    pub away: u64,
    /// Episodes that were acknowledged, by the way in they came by; each of them is there as it was told.
    pub by_way: BTreeMap<&'static str, u64>,
    /// Results that were sent again, and answered as before.
    pub repeated: u64,
    /// Finished episodes that are there.
    pub finished: u64,
    /// Episodes that count.
    pub counted: u64,
    /// Episodes that trainers were told were accepted in columns.
    pub accepted: u64,
    /// Episodes of columns that count.
    pub claimed: u64,
    /// Groups that were delivered.
    pub groups: u64,
    /// Of these, those that were acknowledged; none came again.
    pub acked: u64,
}

impl fmt::Display for Ledger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<52} {:>9}", "servers killed (-9)", self.kills)?;
        writeln!(f, "{:<52} {:>9}", "servers asked to stop (SIGTERM)", self.stops)?;
        writeln!(f, "{:<52} {:>9}", "requests that nobody answered, sent again", self.away)?;
        for (way, episodes) in &self.by_way {
            writeln!(f, "{:<52} {episodes:>9}", format!("episodes acknowledged by {way}, all there"))?;
        }
        writeln!(f, "{:<52} {:>9}", "results sent again, answered as before", self.repeated)?;
        writeln!(f, "{:<52} {:>9}", "finished episodes in the database", self.finished)?;
        writeln!(f, "{:<52} {:>9}", "of these, episodes that count (each once)", self.counted)?;
        writeln!(f, "{:<52} {:>9}", "episodes accepted in columns, as trainers know", self.accepted)?;
        writeln!(f, "{:<52} {:>9}", "episodes of columns that count", self.claimed)?;
        writeln!(f, "{:<52} {:>9}", "groups delivered from the feed", self.groups)?;
        write!(f, "{:<52} {:>9}", "groups acknowledged, none of them came again", self.acked)
    }
}
