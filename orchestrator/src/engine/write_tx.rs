//! The write transaction that the writer hands to each change.

use std::sync::Arc;

use sqlx::SqliteConnection;
use store::history::HistoryBucket;
use store::{DatabaseLock, FileState, Outage, StoreError};

use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::outbox::Outbox;
use crate::engine::run_cache::RunCache;
use crate::engine::run_state::RunState;
use crate::engine::run_tx::RunTx;
use clock::Millis;

/// A write transaction: the connection, the runs in memory and the effects that are left to the end of the transaction.
///
/// [`Self::run`] borrows one run, the connection and the outbox at the same time.
#[derive(Debug)]
pub struct WriteTx {
    /// The writer's connection, inside a transaction.
    pub conn: SqliteConnection,
    /// The time of the change being applied, in milliseconds since the epoch.
    pub now: Millis,
    /// The runs in memory.
    pub runs: RunCache,
    /// Events, history counts and signals of this transaction.
    pub outbox: Outbox,
    /// Lock on the database file; `None` in tests without a file of their own.
    file_lock: Option<Arc<DatabaseLock>>,
    /// True if a change could not be stored since the last successful write probe.
    pub(crate) has_outage: bool,
    /// How far deadlines were shifted in this transaction, in milliseconds.
    pub(crate) clock_shift: Millis,
}

impl WriteTx {
    /// A transaction without effects, and with no run in memory.
    pub(crate) fn new(conn: SqliteConnection, now: Millis, file_lock: Option<Arc<DatabaseLock>>) -> Self {
        Self {
            conn,
            now,
            runs: RunCache::default(),
            outbox: Outbox::default(),
            file_lock,
            has_outage: false,
            clock_shift: 0,
        }
    }

    /// Opens a run for changes. It is restored if it is not in memory.
    ///
    /// # Errors
    /// Returns [`ServiceError::UnknownRun`] if the run does not exist, and another error if it cannot be restored.
    pub async fn run(&mut self, run: &str) -> Result<RunTx<'_>, ServiceError> {
        let Self { conn, runs, outbox, now, .. } = self;
        let state = runs.load(conn, run).await?;
        Ok(RunTx { conn, state, outbox, now: *now })
    }

    /// Emits a run event. Listeners receive it after the commit.
    ///
    /// # Errors
    /// Returns [`ServiceError::Store`] if the event cannot be written as JSON.
    pub fn emit(&mut self, run: &str, event: &RunEvent<'_>) -> Result<(), ServiceError> {
        self.outbox.emit(run, event, self.now)
    }

    /// Returns what the current change adds to the history of a task.
    pub(crate) fn task_counts(&mut self, run: &str, task: &str) -> &mut HistoryBucket {
        self.outbox.task_counts(run, task)
    }

    /// Checks that the files of the database are those that were opened, and hold all that was committed. There must be no
    /// transaction.
    ///
    /// # Errors
    /// Returns [`StoreError::RolledBack`] if a file was removed, replaced or truncated.
    pub(crate) async fn check_files(&mut self) -> Result<(), StoreError> {
        let Some(lock) = &self.file_lock else { return Ok(()) };
        match lock.file_state() {
            FileState::Intact => Ok(()),
            FileState::Replaced => Err(StoreError::RolledBack(Outage::Gone)),
            FileState::Shrunk => lock.verify_sizes(&mut self.conn).await,
        }
    }

    /// Starts a change at this time.
    pub(crate) fn begin_change(&mut self, now: Millis) {
        self.runs.begin_change();
        self.now = now;
    }

    /// Keeps the effects of a change that succeeded until [`Self::flush`].
    pub(crate) fn keep_change(&mut self) {
        let curriculum = self.runs.take_unwritten();
        self.outbox.keep_change(curriculum);
    }

    /// Writes the effects that were kept.
    ///
    /// # Errors
    /// Returns [`StoreError::RolledBack`] if the database file was removed or replaced, or if a statement fails.
    pub(crate) async fn flush(&mut self) -> Result<(), StoreError> {
        if self.file_lock.as_ref().is_some_and(|lock| !lock.is_in_place()) {
            return Err(StoreError::RolledBack(Outage::Gone));
        }
        self.outbox.flush(&mut self.conn, &self.runs, self.now).await
    }

    /// Drops the effects of a change that was undone, and evicts the runs it touched.
    pub(crate) fn discard_change(&mut self) {
        self.outbox.discard_change();
        self.runs.evict_touched();
    }

    /// Drops the effects of the whole transaction, and evicts every run.
    pub(crate) fn discard_all(&mut self) {
        self.outbox.discard_batch();
        self.runs.clear();
    }

    /// Ends the transaction's life and returns the runs in memory and the connection.
    pub(crate) fn into_parts(self) -> (impl Iterator<Item = RunState>, SqliteConnection) {
        (self.runs.into_states(), self.conn)
    }
}
