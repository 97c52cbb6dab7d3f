//! Ending an evaluation that nobody will fly.

use axum::extract::State;

use super::super::super::extract::{NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::id;
use super::view::Evaluation;
use crate::ids::EvaluationId;
use crate::http::state::AppState;
use crate::evaluation::cancel::CancelEvaluation;

/// Cancel an evaluation: it is `failed`, leases of it are refused, and it is none of those under way any more. What was flown of it
/// can still be looked at. Of one that is complete there is nothing to cancel (409); of one that failed nothing changes.
#[utoipa::path(
    post, path = "/evaluations/{evaluation}/cancel", tag = "evaluations",
    params(("evaluation" = String, Path, description = "The evaluation's id.")),
    responses(
        (status = 200, body = Evaluation), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem), (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn cancel(
    _: NoQuery,
    State(app): State<AppState>,
    Path(evaluation): Path<String>,
) -> Result<axum::Json<Evaluation>, Problem> {
    let EvaluationId(number) = id("evaluation", &evaluation)?;
    let row = app.writer.change(CancelEvaluation { id: number }).await?;
    tracing::info!(evaluation = row.id, "An evaluation was cancelled.");
    Ok(axum::Json(row.into()))
}
