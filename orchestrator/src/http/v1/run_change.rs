//! Changing what a run is told.

use axum::extract::State;

use super::super::extract::{Json, NoQuery, Path};
use super::super::problem::Problem;
use super::run_id;
use super::runs::Run;
use crate::http::state::AppState;
use crate::runs::change_run::{ChangeRun, RunChange};

/// Change what a run is told; what is left out stays as it is. Tasks keep their level and mastery unless their table or physics
/// change; under another strategy they keep their mastery, and the strategy starts afresh. What was proposed before and is leased
/// may be reported all the same.
#[utoipa::path(
    patch, path = "/runs/{run}", tag = "runs", request_body = RunChange,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Run), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn change(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(wish): Json<RunChange>,
) -> Result<axum::Json<Run>, Problem> {
    let row = app.writer.change(ChangeRun { run: run_id(&run)?, wish }).await?;
    tracing::info!(run = %row.id, "A run was changed.");
    Ok(axum::Json(Run::of(row)?))
}
