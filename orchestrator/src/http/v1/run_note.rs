//! Note of a run.

use api_types::{RunNoteRequest, RunSummary};
use axum::extract::State;

use super::runs::run_from_row;
use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::runs::set_note::SetNote;

/// Set the note of a run.
///
/// The note is a text of the team, which the list of runs shows and searches. An empty text removes it.
#[utoipa::path(
    put, path = "/runs/{run}/note", tag = "runs", request_body = RunNoteRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 200, body = RunSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn set_note(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(request): Json<RunNoteRequest>,
) -> Result<axum::Json<RunSummary>, Problem> {
    let change = SetNote::from_request(parse_run_id(&run)?, request)?;
    Ok(axum::Json(run_from_row(app.writer.change(change).await?, app.clock.now())?))
}
