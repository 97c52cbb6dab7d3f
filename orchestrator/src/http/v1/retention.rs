//! What a run keeps whole.

use axum::extract::State;

use super::super::extract::{Json, NoQuery, Path};
use super::super::problem::Problem;
use super::run_id;
use super::runs::Run;
use crate::http::state::AppState;
use crate::runs::settings::RetentionRequest;
use crate::runs::run_status::SetRetention;

/// Set what a run keeps whole; what is left out stays as it is. A smaller number takes effect within seconds, and what it lets
/// go does not come back.
#[utoipa::path(
    put, path = "/runs/{run}/retention", tag = "runs", request_body = RetentionRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = Run), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn put(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(wish): Json<RetentionRequest>,
) -> Result<axum::Json<Run>, Problem> {
    let change = SetRetention { run: run_id(&run)?, wish };
    Ok(axum::Json(Run::of(app.writer.change(change).await?)?))
}
