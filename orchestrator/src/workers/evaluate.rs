//! Rolls out built-in policies on suites, one evaluation after the other.

use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;
use store::evaluations::{self, EvaluationRow};
use store::{to_u32, to_u64};

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::evaluations::read::suite_of;
use crate::evaluations::store_results::StoreSuiteResults;
use crate::metrics;
use crate::workers::round_error::ends_worker;
use evaluation::PolicyResults;
use evaluation::suite_rollout::{SuiteRolloutSettings, roll_out_policy};

/// Interval between two checks for an evaluation.
const POLL_INTERVAL: Duration = Duration::from_millis(500);

/// Runs until the writer stops. An evaluation that was interrupted by the end of the server starts over.
pub(super) async fn run(readers: SqlitePool, writer: Writer, pool: Arc<rayon::ThreadPool>) {
    loop {
        match evaluate_oldest(&readers, &writer, &pool).await {
            Ok(true) => continue,
            Ok(false) => {}
            Err(error) if ends_worker(&error, "an evaluation could not be rolled out") => return,
            Err(_) => {}
        }
        tokio::time::sleep(POLL_INTERVAL).await;
    }
}

/// Rolls out the oldest waiting evaluation; false if there is none.
async fn evaluate_oldest(
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
    let results = tokio::task::spawn_blocking(move || pool.install(|| roll_out_suite(&row))).await;
    let results = results.unwrap_or_else(|error| Err(format!("the rollout panicked: {error}")));
    writer.change(StoreSuiteResults { id, results }).await?;
    Ok(true)
}

fn roll_out_suite(row: &EvaluationRow) -> Result<PolicyResults, String> {
    let _busy = metrics::BusyGuard::new("evaluate");
    let suite = suite_of(row).map_err(|error| error.to_string())?;
    let settings = SuiteRolloutSettings { seed: to_u64(row.seed), rollouts: to_u32(row.rollouts) };
    roll_out_policy(&suite.suite, &row.policy, settings, &|| ()).map_err(|error| error.to_string())
}
