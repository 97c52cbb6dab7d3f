//! The two kinds of work that the writer does: changes, which may write, and queries, which read runs in memory.

use std::future::Future;

use sqlx::SqliteConnection;

use crate::engine::error::ServiceError;
use crate::engine::run_cache::RunCache;
use crate::engine::run_state::RunState;
use crate::engine::write_tx::WriteTx;

/// A change of the database. Each use case of the service that writes is one.
pub trait Change: Send + 'static {
    /// Answer that the caller receives after the commit.
    type Output: Send + 'static;
    /// True if the change takes milliseconds and arrives in large numbers: other changes are served first.
    const IS_BULK: bool = false;

    /// Makes the change. An error undoes it.
    fn apply(self, tx: &mut WriteTx) -> impl Future<Output = Result<Self::Output, ServiceError>> + Send;
}

/// A question about runs that the writer has in memory. It writes nothing, and is answered between two transactions.
pub trait StateQuery: Send + 'static {
    /// Answer that the caller receives.
    type Output: Send + 'static;

    /// Reads the answer from the runs in memory, or from the database if needed.
    fn read(self, tx: &mut ReadTx<'_>) -> impl Future<Output = Result<Self::Output, ServiceError>> + Send;
}

/// Access of a [`StateQuery`]: the runs in memory, and the writer's connection for reading what belongs to them.
#[derive(Debug)]
pub struct ReadTx<'a> {
    conn: &'a mut SqliteConnection,
    runs: &'a mut RunCache,
}

impl<'a> ReadTx<'a> {
    /// Read access to everything that a write transaction can see.
    pub(crate) fn new(tx: &'a mut WriteTx) -> Self {
        Self { conn: &mut tx.conn, runs: &mut tx.runs }
    }

    /// Returns a run, restored if it is not in memory, and the connection.
    ///
    /// # Errors
    /// Returns [`ServiceError::UnknownRun`] if the run does not exist, and another error if it cannot be restored.
    pub async fn run(&mut self, run: &str) -> Result<(&RunState, &mut SqliteConnection), ServiceError> {
        let state = self.runs.load(self.conn, run).await?;
        Ok((state.into_ref(), self.conn))
    }

    /// Returns the runs that are in memory, in no particular order.
    pub fn cached_runs(&self) -> impl Iterator<Item = &RunState> {
        self.runs.iter()
    }
}
