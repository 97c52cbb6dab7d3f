//! Deletes archived runs after a time, if the operator sets one.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use sqlx::SqlitePool;
use store::ids::RunId;
use store::runs;

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::retention::archived::ArchivedRetention;
use crate::runs::delete_run::DeleteOverdueRun;
use crate::sessions::SessionManager;
use crate::workers::round_error::ends_worker;
use clock::Clock;

/// Runs that one round deletes at most.
const MAX_RUNS_PER_ROUND: i64 = 256;

/// Worker that deletes archived runs.
pub(super) struct ArchivedRunWorker {
    pub(super) readers: SqlitePool,
    pub(super) writer: Writer,
    pub(super) clock: Clock,
    pub(super) sessions: Arc<SessionManager>,
    pub(super) retention: ArchivedRetention,
}

impl ArchivedRunWorker {
    /// Runs until the writer stops.
    pub(super) async fn run(self) {
        // When each run was first found to be due, by the processor's clock.
        let mut due_since = HashMap::new();
        loop {
            match self.delete_due_runs(&mut due_since).await {
                Ok(()) => {}
                Err(error) if ends_worker(&error, "old archived runs could not be deleted") => return,
                Err(_) => {}
            }
            tokio::time::sleep(self.retention.poll_interval()).await;
        }
    }

    /// Deletes the runs that have been due for the confirmation time. A clock that is wrong for a shorter time deletes nothing.
    async fn delete_due_runs(&self, due_since: &mut HashMap<String, Instant>) -> Result<(), ServiceError> {
        let before = self.clock.now() - self.retention.keep_ms();
        let mut conn = self.readers.acquire().await?;
        let due = runs::archived_before(&mut conn, before, MAX_RUNS_PER_ROUND).await?;
        drop(conn);
        due_since.retain(|run, _| due.contains(run));
        for run in due {
            let since = *due_since.entry(run.clone()).or_insert_with(Instant::now);
            if since.elapsed() >= self.retention.confirmation() {
                self.delete(run, before).await?;
            }
        }
        Ok(())
    }

    async fn delete(&self, run: String, archived_before: i64) -> Result<(), ServiceError> {
        let Ok(id) = run.parse::<RunId>() else { return Ok(()) };
        if self.writer.change(DeleteOverdueRun { run, archived_before }).await? {
            self.sessions.end_run(&id);
            let days = self.retention.keep().as_secs() / Duration::from_hours(24).as_secs();
            tracing::info!(run = %id, days, "An archived run was deleted because of its age.");
        }
        Ok(())
    }
}
