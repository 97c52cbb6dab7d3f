//! History of a run's tasks over time: changes count results, and the counts are written once, at the end of their transaction.

use std::collections::BTreeMap;

use sqlx::SqliteConnection;
use store::StoreError;
use store::history::{self, HistoryBucket, MasterySample};
use store::run_totals;

use crate::engine::run_state::RunState;
use clock::Millis;
use curriculum::{Mastery, TaskStatus};

/// Interval between two samples of the mastery of a run's tasks, in milliseconds. Quantiles are slow to compute, and a busy run
/// commits many transactions a second.
const SAMPLE_INTERVAL: Millis = 2_000;

/// Counts by run and task.
#[derive(Debug, Default)]
pub(crate) struct TaskCounts(BTreeMap<String, BTreeMap<String, HistoryBucket>>);

impl TaskCounts {
    /// Returns the counts of one task.
    pub(crate) fn of(&mut self, run: &str, task: &str) -> &mut HistoryBucket {
        if !self.0.contains_key(run) {
            self.0.insert(run.to_owned(), BTreeMap::new());
        }
        let tasks = self.0.entry(run.to_owned()).or_default();
        tasks.entry(task.to_owned()).or_default()
    }

    /// Returns how many groups of a task had their blind panel examined.
    pub(crate) fn panels(&self, run: &str, task: &str) -> i64 {
        self.0.get(run).and_then(|tasks| tasks.get(task)).map_or(0, |part| part.panel_groups)
    }

    /// Adds the counts of `other`, and leaves it empty.
    pub(crate) fn append(&mut self, other: &mut Self) {
        for (run, tasks) in std::mem::take(&mut other.0) {
            for (task, part) in tasks {
                self.of(&run, &task).join(&part);
            }
        }
    }

    /// Returns the counts of each run, by task.
    pub(crate) fn into_runs(self) -> impl Iterator<Item = (String, BTreeMap<String, HistoryBucket>)> {
        self.0.into_iter()
    }
}

/// Writes the history of one run, and samples the mastery of its tasks now and then.
#[derive(Debug, Default)]
pub(crate) struct HistoryWriter {
    /// Time of the last sample.
    sampled_at: Option<Millis>,
    /// Levels of the run's tasks at the last sample.
    levels: Vec<Option<u32>>,
}

impl HistoryWriter {
    /// Writes the counts of a transaction to the totals and the history, with a sample of mastery if one is due or a level has changed.
    pub(crate) async fn write(
        &mut self,
        conn: &mut SqliteConnection,
        run: &str,
        state: Option<&RunState>,
        mut parts: BTreeMap<String, HistoryBucket>,
        now: Millis,
    ) -> Result<(), StoreError> {
        let has_moved = state.is_some_and(|state| self.levels != levels(state));
        if let Some(state) = state.filter(|_| is_due(&mut self.sampled_at, now) || has_moved) {
            self.levels = levels(state);
            // All tasks are sampled, not only those with new results, so that their curves end at the same time.
            for (task, sample) in current_mastery_samples(state) {
                parts.entry(task).or_default().mastery = Some(sample);
            }
        }
        run_totals::add(conn, run, now, &parts).await?;
        history::add(conn, run, now, &parts).await
    }
}

/// Returns true if the last sample is [`SAMPLE_INTERVAL`] or more away, by a clock that may jump, and then stores `now`.
fn is_due(last: &mut Option<Millis>, now: Millis) -> bool {
    let is_due = last.is_none_or(|last| (now - last).abs() >= SAMPLE_INTERVAL);
    if is_due {
        *last = Some(now);
    }
    is_due
}

/// Returns the levels of a run's tasks.
fn levels(state: &RunState) -> Vec<Option<u32>> {
    state.curriculum.status().into_iter().map(|status| status.level).collect()
}

/// Returns level and mastery of each task of a run.
pub(crate) fn current_mastery_samples(state: &RunState) -> BTreeMap<String, MasterySample> {
    mastery_samples(&state.curriculum.status(), &state.curriculum.mastery())
}

/// Returns level and mastery of each task, in the form that the history stores.
#[must_use]
pub fn mastery_samples(status: &[TaskStatus], mastery: &[Mastery]) -> BTreeMap<String, MasterySample> {
    let of = |status: &TaskStatus| {
        let known = mastery.iter().find(|known| known.task == status.task && known.level == status.level);
        let level = status.level.map(i64::from);
        // A level without evidence has the prior Beta(1, 1).
        let (mean, q10, q90) = known.map_or((0.5, 0.1, 0.9), |known| (known.mean, known.q10, known.q90));
        let is_known = known.is_some() || level.is_some();
        is_known.then(|| (status.task.clone(), MasterySample { level, mean, q10, q90 }))
    };
    status.iter().filter_map(of).collect()
}
