//! What the agent has mastered: the posterior over success on contested scenarios, per task and level.

use std::collections::{BTreeMap, VecDeque};

use serde::{Deserialize, Serialize};

use super::event::GroupOutcome;
use super::posterior::Posterior;
use super::settings::Settings;

/// Scenarios remembered per task and level. An agent that trains is not the agent it was: what it did long ago says
/// little about now, so old values leave (two blocks of the ladder).
const MEMORY: usize = 64;

/// The posterior over success on contested scenarios of a task and level: Beta(1, 1) and the last 64 values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mastery {
    /// The task's id.
    pub task: String,
    /// The level; none for the task's default params.
    pub level: Option<u32>,
    /// Scenarios it rests on, at most 64.
    pub n: u32,
    /// Sum of their success shares.
    pub sum: f64,
    /// The posterior's mean, (1 + sum)/(2 + n).
    pub mean: f64,
    /// The posterior's 10 % quantile.
    pub q10: f64,
    /// The posterior's 90 % quantile.
    pub q90: f64,
    /// Scenarios seen since the run began.
    pub seen: u64,
}

/// The values behind a [`Mastery`], as they are stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredMastery {
    /// The task's id.
    pub task: String,
    /// The level.
    pub level: Option<u32>,
    /// The values, oldest first.
    pub values: Vec<f64>,
    /// Scenarios seen since the run began.
    pub seen: u64,
}

#[derive(Debug, Clone, Default)]
struct Ring {
    values: VecDeque<f64>,
    seen: u64,
}

/// Keeps the values of every task and level.
#[derive(Debug, Clone, Default)]
pub(super) struct Tracker {
    rings: BTreeMap<String, BTreeMap<Option<u32>, Ring>>,
}

impl Tracker {
    /// Takes an outcome into its own level's mastery, whatever it was proposed for. Only contested evidence counts, of scenarios as
    /// they are drawn: those chosen because the agent fails on them say nothing of the others.
    pub(super) fn observe(&mut self, outcome: &GroupOutcome) {
        let counts = outcome.contested && outcome.evidence && outcome.source.is_fresh();
        let Some(value) = outcome.value().filter(|_| counts) else { return };
        let ring = self.rings.entry(outcome.task.clone()).or_default().entry(outcome.level).or_default();
        if ring.values.len() == MEMORY {
            ring.values.pop_front();
        }
        ring.values.push_back(value);
        ring.seen += 1;
    }

    /// Forgets a task.
    pub(super) fn forget(&mut self, task: &str) {
        self.rings.remove(task);
    }

    /// Every task and level with evidence, in the order of the settings.
    pub(super) fn mastery(&self, settings: &Settings) -> Vec<Mastery> {
        let rings = settings.tasks.iter().filter_map(|plan| self.rings.get_key_value(&plan.task));
        rings
            .flat_map(|(task, levels)| levels.iter().map(|(level, ring)| mastery(task, *level, ring)))
            .collect()
    }

    pub(super) fn store(&self) -> Vec<StoredMastery> {
        let stored = |task: &String, (level, ring): (&Option<u32>, &Ring)| StoredMastery {
            task: task.clone(),
            level: *level,
            values: ring.values.iter().copied().collect(),
            seen: ring.seen,
        };
        self.rings
            .iter()
            .flat_map(|(task, levels)| levels.iter().map(move |entry| stored(task, entry)))
            .collect()
    }

    pub(super) fn restore(stored: Vec<StoredMastery>) -> Self {
        let mut tracker = Self::default();
        for StoredMastery { task, level, values, seen } in stored {
            let values = values.into_iter().collect();
            tracker.rings.entry(task).or_default().insert(level, Ring { values, seen });
        }
        tracker
    }
}

fn mastery(task: &str, level: Option<u32>, ring: &Ring) -> Mastery {
    // Added up anew each time, in order: a running sum would keep the rounding of values long gone.
    let sum: f64 = ring.values.iter().sum();
    let n = u32::try_from(ring.values.len()).unwrap_or(u32::MAX);
    let posterior = Posterior { n, sum };
    Mastery {
        task: task.to_owned(),
        level,
        n,
        sum,
        mean: posterior.mean(),
        q10: posterior.quantile(0.10),
        q90: posterior.quantile(0.90),
        seen: ring.seen,
    }
}
