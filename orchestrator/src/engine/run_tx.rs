//! The part of a write transaction that belongs to one run.

use sqlx::SqliteConnection;
use store::history::HistoryBucket;
use store::{StoreError, runs};

use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::outbox::Outbox;
use crate::engine::run_cache::CachedRun;
use crate::engine::signals::Signal;
use clock::Millis;

/// One run inside a write transaction: its state, the connection and the outbox, borrowed at the same time.
#[derive(Debug)]
pub struct RunTx<'a> {
    /// The writer's connection, inside a transaction.
    pub conn: &'a mut SqliteConnection,
    /// The run in memory.
    pub state: CachedRun<'a>,
    /// Events, history counts and signals of this transaction.
    pub outbox: &'a mut Outbox,
    /// The time of the change being applied, in milliseconds since the epoch.
    pub now: Millis,
}

impl RunTx<'_> {
    /// Time by which the deadlines of the run's leases are judged.
    #[must_use]
    pub fn lease_clock(&self) -> Millis {
        self.state.lease_clock(self.now)
    }

    /// Emits an event of the run. Listeners receive it after the commit.
    ///
    /// # Errors
    /// Returns [`ServiceError::Store`] if the event cannot be written as JSON.
    pub fn emit(&mut self, event: &RunEvent<'_>) -> Result<(), ServiceError> {
        self.outbox.emit(&self.state.run, event, self.now)
    }

    /// Sets the newest policy version of the run.
    ///
    /// # Errors
    /// Returns [`StoreError::Database`] if the statement fails.
    pub async fn set_policy_version(&mut self, version: i64) -> Result<(), StoreError> {
        if self.state.policy_version != version {
            self.state.policy_version = version;
            runs::set_policy_version(self.conn, &self.state.run, version).await?;
            self.outbox.signal(Signal::RunStates);
        }
        Ok(())
    }

    /// Returns what the current change adds to the history of a task.
    pub(crate) fn task_counts(&mut self, task: &str) -> &mut HistoryBucket {
        self.outbox.task_counts(&self.state.run, task)
    }
}
