//! Flies built-in policies on suites, one evaluation after the other.

use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;

use crate::counts;
use crate::evaluation::fly;
use crate::store::evaluations::{self, EvaluationRow};
use crate::store::{small, unsigned};
use crate::training::evaluation::fill::Fly;
use crate::training::evaluation::read::suite_of;
use crate::training::{TrainingError, Writer};

/// How often it looks.
const EVERY: Duration = Duration::from_millis(500);

/// Works until the writer is gone. What was under way when the server went away is flown again.
pub async fn run(readers: SqlitePool, writer: Writer, pool: Arc<rayon::ThreadPool>) {
    loop {
        match next(&readers, &writer, &pool).await {
            Ok(true) => continue,
            Ok(false) | Err(TrainingError::Busy) => {}
            Err(TrainingError::Stopping) => return,
            Err(error) => {
                tracing::error!(error = %error, "An evaluation could not be flown; trying again soon.");
            }
        }
        tokio::time::sleep(EVERY).await;
    }
}

/// Flies the oldest; whether there was one.
async fn next(
    readers: &SqlitePool,
    writer: &Writer,
    pool: &Arc<rayon::ThreadPool>,
) -> Result<bool, TrainingError> {
    let row = {
        let mut conn = readers.acquire().await?;
        let Some(id) = evaluations::flying(&mut conn).await? else { return Ok(false) };
        evaluations::get(&mut conn, id).await?
    };
    let Some(row) = row else { return Ok(false) };
    let (id, pool) = (row.id, Arc::clone(pool));
    let flown = tokio::task::spawn_blocking(move || pool.install(|| flown(&row))).await;
    let flown = flown.unwrap_or_else(|error| Err(format!("what flew it ended: {error}")));
    writer.change(Fly { id, flown }).await?;
    Ok(true)
}

fn flown(row: &EvaluationRow) -> Result<crate::evaluation::Flown, String> {
    let _busy = counts::Busy::with("evaluate");
    let suite = suite_of(row).map_err(|error| error.to_string())?;
    let terms = (unsigned(row.seed), small(row.rollouts));
    fly::fly(&suite.suite, &row.policy, terms, &|| ()).map_err(|error| error.to_string())
}
