//! Rolls out built-in policies and policy files on suites, one evaluation after the other.

use std::sync::Arc;
use std::time::Duration;

use policy_files::{PolicyFolder, PolicyReference};
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

/// Worker that rolls out evaluations.
#[derive(Debug, Clone)]
pub(super) struct EvaluationWorker {
    /// Pool of connections that read.
    pub readers: SqlitePool,
    /// Handle of the database's only writer.
    pub writer: Writer,
    /// Folder of policy files, if one is configured.
    pub policy_folder: PolicyFolder,
    /// Threads of this worker, at background priority.
    pub pool: Arc<rayon::ThreadPool>,
}

impl EvaluationWorker {
    /// Runs until the writer stops. An evaluation that was interrupted by the end of the server starts over.
    pub(super) async fn run(self) {
        loop {
            match self.evaluate_oldest().await {
                Ok(true) => continue,
                Ok(false) => {}
                Err(error) if ends_worker(&error, "an evaluation could not be rolled out") => return,
                Err(_) => {}
            }
            tokio::time::sleep(POLL_INTERVAL).await;
        }
    }

    /// Rolls out the oldest waiting evaluation; false if there is none.
    async fn evaluate_oldest(&self) -> Result<bool, ServiceError> {
        let row = {
            let mut conn = self.readers.acquire().await?;
            let Some(id) = evaluations::oldest_of_server(&mut conn).await? else { return Ok(false) };
            evaluations::get(&mut conn, id).await?
        };
        let Some(row) = row else { return Ok(false) };
        let (id, pool, folder) = (row.id, Arc::clone(&self.pool), self.policy_folder.clone());
        let results =
            tokio::task::spawn_blocking(move || pool.install(|| roll_out_suite(&row, &folder))).await;
        let results = results.unwrap_or_else(|error| Err(format!("the rollout panicked: {error}")));
        self.writer.change(StoreSuiteResults { id, results }).await?;
        Ok(true)
    }
}

fn roll_out_suite(row: &EvaluationRow, folder: &PolicyFolder) -> Result<PolicyResults, String> {
    let _busy = metrics::BusyGuard::new("evaluate");
    let suite = suite_of(row).map_err(|error| error.to_string())?;
    let settings = SuiteRolloutSettings { seed: to_u64(row.seed), rollouts: to_u32(row.rollouts) };
    let policy = folder.open(&PolicyReference::parse(&row.policy)).map_err(|error| error.to_string())?;
    roll_out_policy(&suite.suite, &*policy, settings, &|| ()).map_err(|error| error.to_string())
}
