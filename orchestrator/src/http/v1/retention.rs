//! Retention settings of a run.

use api_types::{RetentionRequest, RunSummary};
use axum::extract::State;

use super::runs::run_from_row;
use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::runs::set_retention::SetRetention;

/// Set how many episodes a run keeps complete.
///
/// Fields that are left out keep their values. A smaller number takes effect within seconds; deleted data cannot be restored.
#[utoipa::path(
    put, path = "/runs/{run}/retention", tag = "runs", request_body = RetentionRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn set_retention(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(request): Json<RetentionRequest>,
) -> Result<axum::Json<RunSummary>, Problem> {
    let change = SetRetention { run: parse_run_id(&run)?, request };
    Ok(axum::Json(run_from_row(app.writer.change(change).await?, app.clock.now())?))
}
