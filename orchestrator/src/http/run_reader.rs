//! Reads that many handlers begin with: a snapshot of the database with a run that exists, and the tasks of a run.

use env_core::TaskSpec;
use sqlx::{Sqlite, SqliteConnection, Transaction};
use store::ids::RunId;
use store::{from_json, runs};

use super::problem::Problem;
use super::state::AppState;
use crate::engine::error::ServiceError;
use crate::runs::settings::RunSettings;

/// Begins to read one snapshot of the database, and checks that the run exists.
///
/// # Errors
/// Returns [`ServiceError::UnknownRun`] as a problem if there is no such run.
pub(super) async fn acquire_run_reader(
    app: &AppState,
    run: &RunId,
) -> Result<Transaction<'static, Sqlite>, Problem> {
    let mut conn = app.readers.begin().await?;
    match runs::get(&mut conn, run.as_str()).await? {
        Some(_) => Ok(conn),
        None => Err(ServiceError::UnknownRun(run.to_string()).into()),
    }
}

/// Returns the tasks of a run, or only the `wanted` one.
///
/// # Errors
/// Returns a problem if there is no such run or the run has no such task.
pub(super) async fn find_run_tasks(
    conn: &mut SqliteConnection,
    run: &RunId,
    wanted: Option<&str>,
) -> Result<Vec<&'static dyn TaskSpec>, Problem> {
    let row = runs::get(conn, run.as_str()).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownRun(run.to_string()))?;
    let settings: RunSettings = from_json("a run's settings", &row.settings)?;
    let known: Vec<_> =
        settings.curriculum.tasks.iter().filter_map(|plan| env_core::task(&plan.task)).collect();
    let Some(wanted) = wanted else { return Ok(known) };
    match known.iter().find(|task| task.id() == wanted) {
        Some(task) => Ok(vec![*task]),
        None => {
            let known: Vec<_> = known.iter().map(|task| task.id()).collect();
            let detail = format!("must be a task of the run: {}", known.join(", "));
            Err(Problem::invalid("task", detail))
        }
    }
}
