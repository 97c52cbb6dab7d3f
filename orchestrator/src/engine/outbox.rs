//! Effects of a transaction that are written once, before its commit, or signalled after it.

use std::collections::{BTreeMap, HashMap};

use sqlx::SqliteConnection;
use store::StoreError;
use store::curriculum::{self, NewCurriculumEvent};
use store::events::{self, NewEvent};
use store::history::HistoryBucket;

use crate::engine::run_cache::RunCache;
use crate::engine::signals::{Signal, WorkerSignals};
use crate::engine::task_history::{HistoryWriter, TaskCounts};
use clock::Millis;

/// Events of a run between two trims of its ring of kept events.
const TRIM_EVERY: u32 = 1_000;

/// Collects run events, history counts and signals of a transaction. Many rows take one statement, so all changes of a transaction
/// are written together.
#[derive(Debug, Default)]
pub struct Outbox {
    /// Effects of the change being applied.
    change: Effects,
    /// Effects of the changes of this transaction that succeeded.
    batch: Effects,
    /// Signals to send after the commit.
    signals: Vec<Signal>,
    /// History state of each run.
    histories: HashMap<String, HistoryWriter>,
    /// Events emitted for each run since its ring was trimmed.
    since_trim: HashMap<String, u32>,
    /// Runs that this transaction deletes.
    deleted_runs: Vec<String>,
}

#[derive(Debug, Default)]
struct Effects {
    events: Vec<NewEvent>,
    /// Curriculum events by run.
    curriculum: BTreeMap<String, Vec<NewCurriculumEvent>>,
    counts: TaskCounts,
}

impl Outbox {
    /// Adds a run event to the current change.
    pub(crate) fn push_event(&mut self, event: NewEvent) {
        self.change.events.push(event);
    }

    /// Returns what the current change adds to the history of a task.
    pub(crate) fn task_counts(&mut self, run: &str, task: &str) -> &mut HistoryBucket {
        self.change.counts.of(run, task)
    }

    /// Returns how many groups of a task had their blind panel examined in this transaction.
    pub(crate) fn examined_panels(&self, run: &str, task: &str) -> i64 {
        self.change.counts.panels(run, task) + self.batch.counts.panels(run, task)
    }

    /// Sends a signal after the commit.
    pub fn signal(&mut self, signal: Signal) {
        if !self.signals.contains(&signal) {
            self.signals.push(signal);
        }
    }

    /// Forgets the history state of a run that the current change deletes, once the transaction is written.
    pub(crate) fn forget_run(&mut self, run: &str) {
        self.deleted_runs.push(run.to_owned());
    }

    /// Keeps the effects of a change that succeeded.
    pub(crate) fn keep_change(&mut self, curriculum: Vec<(String, Vec<NewCurriculumEvent>)>) {
        self.batch.events.append(&mut self.change.events);
        self.batch.counts.append(&mut self.change.counts);
        for (run, events) in curriculum {
            self.batch.curriculum.entry(run).or_default().extend(events);
        }
    }

    /// Drops the effects of a change that was undone.
    pub(crate) fn discard_change(&mut self) {
        self.change = Effects::default();
    }

    /// Drops the effects of a transaction that was undone.
    pub(crate) fn discard_batch(&mut self) {
        self.discard_change();
        self.batch = Effects::default();
    }

    /// Writes the kept effects.
    pub(crate) async fn flush(
        &mut self,
        conn: &mut SqliteConnection,
        runs: &RunCache,
        now: Millis,
    ) -> Result<(), StoreError> {
        let Effects { events, curriculum, counts } = std::mem::take(&mut self.batch);
        for (run, events) in curriculum {
            curriculum::append(conn, &run, &events).await?;
        }
        for (run, parts) in counts.into_runs() {
            let history = self.histories.entry(run.clone()).or_default();
            history.write(conn, &run, runs.get(&run), parts, now).await?;
        }
        self.write_events(conn, events).await?;
        for run in self.deleted_runs.drain(..) {
            self.histories.remove(&run);
            self.since_trim.remove(&run);
        }
        Ok(())
    }

    /// Writes run events, and trims the rings of kept events that are due.
    async fn write_events(
        &mut self,
        conn: &mut SqliteConnection,
        events: Vec<NewEvent>,
    ) -> Result<(), StoreError> {
        if events.is_empty() {
            return Ok(());
        }
        self.signal(Signal::Events);
        events::append(conn, &events).await?;
        for NewEvent { run, .. } in &events {
            // A run without events since the start of the server is trimmed soon.
            let since_trim = self.since_trim.entry(run.clone()).or_insert(TRIM_EVERY / 2 - 1);
            *since_trim += 1;
            if *since_trim >= TRIM_EVERY {
                *since_trim = 0;
                events::trim(conn, run).await?;
            }
        }
        Ok(())
    }

    /// Sends the signals of the transaction.
    pub(crate) fn send_signals(&mut self, signals: &WorkerSignals) {
        for signal in self.signals.drain(..) {
            signals.send(signal);
        }
    }
}
