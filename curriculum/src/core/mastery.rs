//! Mastery: the posterior over success on contested scenarios, per task and level.

use std::collections::{BTreeMap, VecDeque};

use serde::{Deserialize, Serialize};

use super::evidence::posterior::Posterior;
use super::outcome::GroupOutcome;
use super::settings::Settings;

/// Number of scenarios remembered per task and level: two blocks of the ladder. The agent changes while it trains, so
/// old success rates say little about now and are dropped.
const WINDOW: usize = 64;

/// Posterior over success on contested scenarios of a task and level: Beta(1, 1) updated with the last 64 groups.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mastery {
    /// Id of the task.
    pub task: String,
    /// Level; `None` for groups whose params belong to no level.
    pub level: Option<u32>,
    /// Number of scenarios in the window, at most 64.
    pub n: u32,
    /// Sum of their success rates.
    pub sum: f64,
    /// Posterior mean, (1 + sum)/(2 + n).
    pub mean: f64,
    /// 10 % quantile of the posterior.
    pub q10: f64,
    /// 90 % quantile of the posterior.
    pub q90: f64,
    /// Number of scenarios seen since the run began.
    pub seen: u64,
}

/// Stored form of a [`Mastery`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredMastery {
    /// Id of the task.
    pub task: String,
    /// Level; `None` for groups whose params belong to no level.
    pub level: Option<u32>,
    /// Success rates in the window, oldest first.
    pub values: Vec<f64>,
    /// Number of scenarios seen since the run began.
    pub seen: u64,
}

/// Latest success rates of one task and level.
#[derive(Debug, Clone, Default)]
struct RecentValues {
    values: VecDeque<f64>,
    seen: u64,
}

/// Collects the latest success rates of every task and level.
#[derive(Debug, Clone, Default)]
pub(crate) struct MasteryTracker {
    recent: BTreeMap<String, BTreeMap<Option<u32>, RecentValues>>,
}

impl MasteryTracker {
    /// Records an outcome at its own level, whatever its role. Only contested evidence on fresh scenarios counts:
    /// scenarios selected because the agent fails on them say nothing about the others.
    pub(crate) fn observe(&mut self, outcome: &GroupOutcome) {
        let counts = outcome.contested && outcome.evidence && outcome.source.is_fresh();
        let Some(success_rate) = outcome.success_rate().filter(|_| counts) else { return };
        let levels = self.recent.entry(outcome.task.clone()).or_default();
        let recent = levels.entry(outcome.level).or_default();
        if recent.values.len() == WINDOW {
            recent.values.pop_front();
        }
        recent.values.push_back(success_rate);
        recent.seen += 1;
    }

    /// Drops all success rates of a task.
    pub(crate) fn forget(&mut self, task: &str) {
        self.recent.remove(task);
    }

    /// Mastery of every task and level with evidence, in the order of the settings.
    pub(crate) fn mastery(&self, settings: &Settings) -> Vec<Mastery> {
        let tasks = settings.tasks.iter().filter_map(|plan| self.recent.get_key_value(&plan.task));
        tasks
            .flat_map(|(task, levels)| levels.iter().map(|(level, recent)| mastery_of(task, *level, recent)))
            .collect()
    }

    /// Stored form of all success rates.
    pub(crate) fn store(&self) -> Vec<StoredMastery> {
        let stored = |task: &String, level: Option<u32>, recent: &RecentValues| StoredMastery {
            task: task.clone(),
            level,
            values: recent.values.iter().copied().collect(),
            seen: recent.seen,
        };
        self.recent
            .iter()
            .flat_map(|(task, levels)| levels.iter().map(move |(level, recent)| stored(task, *level, recent)))
            .collect()
    }

    /// Restores a tracker from its stored form.
    pub(crate) fn restore(stored: Vec<StoredMastery>) -> Self {
        let mut tracker = Self::default();
        for StoredMastery { task, level, values, seen } in stored {
            let values = values.into_iter().collect();
            tracker.recent.entry(task).or_default().insert(level, RecentValues { values, seen });
        }
        tracker
    }
}

fn mastery_of(task: &str, level: Option<u32>, recent: &RecentValues) -> Mastery {
    // Summed in order each time: a running sum would keep the rounding errors of values that were dropped.
    let sum: f64 = recent.values.iter().sum();
    let n = u32::try_from(recent.values.len()).unwrap_or(u32::MAX);
    let posterior = Posterior { n, sum };
    Mastery {
        task: task.to_owned(),
        level,
        n,
        sum,
        mean: posterior.mean(),
        q10: posterior.quantile(0.10),
        q90: posterior.quantile(0.90),
        seen: recent.seen,
    }
}
