//! Mastery: the posterior over success on contested scenarios, per task and level.

use std::collections::{BTreeMap, VecDeque};

use serde::{Deserialize, Serialize};

use super::evidence::block::{MIN_SLOTS_FOR_WARNING, MISSING_WARNING_SHARE, format_count};
use super::evidence::interval::SuccessInterval;
use super::evidence::posterior::Posterior;
use super::evidence::slot_queue::SlotQueue;
use super::outcome::GroupOutcome;
use super::settings::Settings;
use super::slot::{Slot, StalledSlot};

/// Number of slots remembered per task and level: two blocks of the ladder. The agent changes while it trains, so old
/// success rates say little about now and are dropped.
const WINDOW: usize = 64;

/// Posterior over success on contested scenarios of a task and level: Beta(1, 1) updated with the last 64 settled
/// slots. The mean and the 10 % quantile count missing episodes as failures, the 90 % quantile as successes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mastery {
    /// Id of the task.
    pub task: String,
    /// Level; `None` for groups whose params belong to no level.
    pub level: Option<u32>,
    /// Number of slots in the window, at most 64.
    pub n: u32,
    /// Sum of their success rates, missing episodes counted as failures.
    pub low: f64,
    /// Sum of their success rates, missing episodes counted as successes.
    pub high: f64,
    /// Posterior mean in the worst case, (1 + low)/(2 + n).
    pub mean: f64,
    /// 10 % quantile of the posterior in the worst case.
    pub q10: f64,
    /// 90 % quantile of the posterior in the best case.
    pub q90: f64,
    /// Share of the outcomes that are missing, (high − low)/n; 0 without slots.
    pub missing: f64,
    /// Number of slots without a value, and of those that wait for them.
    pub open: u32,
    /// Number of slots settled since the run began.
    pub seen: u64,
}

/// Stored form of a [`Mastery`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredMastery {
    /// Id of the task.
    pub task: String,
    /// Level; `None` for groups whose params belong to no level.
    pub level: Option<u32>,
    /// Values of the slots in the window, oldest first.
    pub values: Vec<SuccessInterval>,
    /// Slots that are not settled.
    pub(crate) queue: SlotQueue,
    /// Number of slots settled since the run began.
    pub seen: u64,
}

/// Latest slots of one task and level.
#[derive(Debug, Clone, Default)]
struct RecentSlots {
    queue: SlotQueue,
    values: VecDeque<SuccessInterval>,
    seen: u64,
}

impl RecentSlots {
    fn settle(&mut self) {
        while let Some(settled) = self.queue.next_settled() {
            if self.values.len() == WINDOW {
                self.values.pop_front();
            }
            self.values.push_back(settled.value);
            self.seen = self.seen.saturating_add(1);
        }
    }
}

/// Collects the latest slots of every task and level.
#[derive(Debug, Clone, Default)]
pub(crate) struct MasteryTracker {
    recent: BTreeMap<String, BTreeMap<Option<u32>, RecentSlots>>,
}

impl MasteryTracker {
    /// Records a slot at its own level, whatever its role.
    pub(crate) fn open(&mut self, slot: &Slot) {
        let levels = self.recent.entry(slot.task.clone()).or_default();
        levels.entry(slot.level).or_default().queue.open(slot);
    }

    /// Drops a slot that will have no value.
    pub(crate) fn withdraw(&mut self, slot: &Slot) {
        if let Some(recent) = self.slots(&slot.task, slot.level)
            && recent.queue.withdraw(slot.key())
        {
            recent.settle();
        }
    }

    /// Records the value of a slot.
    pub(crate) fn observe(&mut self, outcome: &GroupOutcome) {
        if let Some(value) = outcome.evidence
            && let Some(recent) = self.slots(&outcome.task, outcome.level)
            && recent.queue.resolve(outcome.slot_key(), value)
        {
            recent.settle();
        }
    }

    fn slots(&mut self, task: &str, level: Option<u32>) -> Option<&mut RecentSlots> {
        self.recent.get_mut(task)?.get_mut(&level)
    }

    /// Drops all slots of a task.
    pub(crate) fn forget(&mut self, task: &str) {
        self.recent.remove(task);
    }

    /// First open slot of each task and level for which at least `min_later` results of later leases wait.
    pub(crate) fn stalled(&self, min_later: u32) -> impl Iterator<Item = StalledSlot> {
        let queues = self.recent.values().flat_map(BTreeMap::values).map(|recent| &recent.queue);
        queues.filter_map(move |queue| queue.stalled(min_later))
    }

    /// Warning about missing outcomes of a task, at the level whose latest outcomes are missing most.
    pub(crate) fn missing_warning(&self, task: &str) -> Option<String> {
        let counted = self.recent.get(task)?.iter().map(|(level, recent)| {
            let missing: f64 = recent.values.iter().map(|value| value.missing()).sum();
            (missing, recent.values.len() as f64, level)
        });
        let is_much = |(missing, n, _): &(f64, f64, _)| {
            *n >= f64::from(MIN_SLOTS_FOR_WARNING) && *missing > MISSING_WARNING_SHARE * n
        };
        let much = counted.filter(is_much);
        let (missing, n, level) = much.max_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)))?;
        let place = level.map_or_else(String::new, |level| format!(" at level {level}"));
        Some(format!(
            "{} of the last {n} outcomes{place} are missing; missing episodes count as failures for moves up, \
             and as successes for moves down",
            format_count(missing)
        ))
    }

    /// Mastery of every task and level with slots, in the order of the settings.
    pub(crate) fn mastery(&self, settings: &Settings) -> Vec<Mastery> {
        let tasks = settings.tasks.iter().filter_map(|plan| self.recent.get_key_value(&plan.task));
        tasks
            .flat_map(|(task, levels)| levels.iter().map(|(level, recent)| mastery_of(task, *level, recent)))
            .collect()
    }

    /// Stored form of all slots.
    pub(crate) fn store(&self) -> Vec<StoredMastery> {
        let stored = |task: &String, level: Option<u32>, recent: &RecentSlots| StoredMastery {
            task: task.clone(),
            level,
            values: recent.values.iter().copied().collect(),
            queue: recent.queue.clone(),
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
        for StoredMastery { task, level, values, queue, seen } in stored {
            let values = values.into_iter().collect();
            tracker.recent.entry(task).or_default().insert(level, RecentSlots { queue, values, seen });
        }
        tracker
    }
}

fn mastery_of(task: &str, level: Option<u32>, recent: &RecentSlots) -> Mastery {
    // Summed in order each time: a running sum would keep the rounding errors of values that were dropped.
    let low: f64 = recent.values.iter().map(|value| value.low).sum();
    let high: f64 = recent.values.iter().map(|value| value.high).sum();
    let n = u32::try_from(recent.values.len()).unwrap_or(u32::MAX);
    let (worst, best) = (Posterior { n, sum: low }, Posterior { n, sum: high });
    Mastery {
        task: task.to_owned(),
        level,
        n,
        low,
        high,
        mean: worst.mean(),
        q10: worst.quantile(0.10),
        q90: best.quantile(0.90),
        missing: if n == 0 { 0.0 } else { (high - low) / f64::from(n) },
        open: u32::try_from(recent.queue.len()).unwrap_or(u32::MAX),
        seen: recent.seen,
    }
}
