//! Tags of a run.

use api_types::{RunSummary, RunTagsRequest};
use axum::extract::State;

use super::runs::run_from_row;
use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::runs::set_tags::SetTags;

/// Replace the tags of a run.
///
/// An empty list removes all tags. A repeated tag counts once.
#[utoipa::path(
    put, path = "/runs/{run}/tags", tag = "runs", request_body = RunTagsRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn set_tags(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(request): Json<RunTagsRequest>,
) -> Result<axum::Json<RunSummary>, Problem> {
    let change = SetTags::from_request(parse_run_id(&run)?, &request.tags)?;
    Ok(axum::Json(run_from_row(app.writer.change(change).await?, app.clock.now())?))
}
