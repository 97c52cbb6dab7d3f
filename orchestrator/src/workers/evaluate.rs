//! Flies built-in policies on suites, one evaluation after the other.

use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;

use crate::metrics;
use crate::evaluation::suite_rollout::{SuiteRolloutSettings, roll_out_policy};
use crate::store::evaluations::{self, EvaluationRow};
use crate::store::{to_u32, to_u64};
use crate::evaluation::fill::Fly;
use crate::evaluation::read::suite_of;
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;

/// How often it looks.
const EVERY: Duration = Duration::from_millis(500);

/// Works until the writer is gone. What was under way when the server went away is flown again.
pub async fn run(readers: SqlitePool, writer: Writer, pool: Arc<rayon::ThreadPool>) {
    loop {
        match next(&readers, &writer, &pool).await {
            Ok(true) => continue,
            Ok(false) | Err(ServiceError::Busy) => {}
            Err(ServiceError::Stopping) => return,
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
) -> Result<bool, ServiceError> {
    let row = {
        let mut conn = readers.acquire().await?;
        let Some(id) = evaluations::oldest_of_server(&mut conn).await? else { return Ok(false) };
        evaluations::get(&mut conn, id).await?
    };
    let Some(row) = row else { return Ok(false) };
    let (id, pool) = (row.id, Arc::clone(pool));
    let flown = tokio::task::spawn_blocking(move || pool.install(|| flown(&row))).await;
    let flown = flown.unwrap_or_else(|error| Err(format!("what flew it ended: {error}")));
    writer.change(Fly { id, flown }).await?;
    Ok(true)
}

fn flown(row: &EvaluationRow) -> Result<crate::evaluation::PolicyResults, String> {
    let _busy = metrics::BusyGuard::new("evaluate");
    let suite = suite_of(row).map_err(|error| error.to_string())?;
    let settings = SuiteRolloutSettings { seed: to_u64(row.seed), rollouts: to_u32(row.rollouts) };
    roll_out_policy(&suite.suite, &row.policy, settings, &|| ()).map_err(|error| error.to_string())
}
