//! Cancellation of an evaluation.

use api_types::EvaluationSummary;
use axum::Extension;
use axum::extract::State;
use store::ids::EvaluationId;

use super::view::evaluation_summary;
use crate::evaluations::cancel::CancelEvaluation;
use crate::http::access::Caller;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::parse_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// Cancel an evaluation.
///
/// Only the owner of the evaluated run or an admin can cancel; without a run, the principal that created the evaluation or an admin.
/// The evaluation becomes `failed` and grants no more leases; its results so far remain. A complete evaluation cannot be cancelled
/// (409). A failed evaluation does not change.
#[utoipa::path(
    post, path = "/evaluations/{evaluation}/cancel", tag = "evaluations",
    params(("evaluation" = String, Path, description = "The evaluation's id.")),
    responses(
        (status = 200, body = EvaluationSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem), (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn cancel_evaluation(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    Path(evaluation): Path<String>,
) -> Result<axum::Json<EvaluationSummary>, Problem> {
    let EvaluationId { number, .. } = parse_id("evaluation", &evaluation)?;
    let row = app.writer.change(CancelEvaluation { id: number, actor: caller.actor() }).await?;
    tracing::info!(evaluation = row.id, "Evaluation cancelled.");
    Ok(axum::Json(evaluation_summary(row, app.shards.own())))
}
