//! Update of a run's settings.

use api_types::{RunSummary, RunUpdate};
use axum::extract::State;

use super::runs::run_from_row;
use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::runs::change_run::ChangeRun;

/// Update the settings of a run.
///
/// Fields that are left out keep their values. A task keeps its level and mastery unless its level table or physics change. A change
/// of the strategy keeps the mastery of tasks and resets the state of the strategy. Results of existing leases are still accepted.
#[utoipa::path(
    patch, path = "/runs/{run}", tag = "runs", request_body = RunUpdate,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn update_run(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(change): Json<RunUpdate>,
) -> Result<axum::Json<RunSummary>, Problem> {
    let row = app.writer.change(ChangeRun { run: parse_run_id(&run)?, change }).await?;
    tracing::info!(run = %row.id, "Run updated.");
    Ok(axum::Json(run_from_row(row, app.clock.now())?))
}
