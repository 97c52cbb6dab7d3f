//! One evaluation with its results.

use api_types::Evaluation;
use axum::extract::State;
use store::evaluations::{self, EvaluationState};
use store::ids::EvaluationId;

use super::view::evaluation_summary;
use crate::engine::error::ServiceError;
use crate::evaluations::read::{load_evaluation, report_evaluation};
use crate::http::blocking::run_blocking;
use crate::http::extract::{NoQuery, Path};
use crate::http::path_ids::parse_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// Get an evaluation, with its results if it is complete.
#[utoipa::path(
    get, path = "/evaluations/{evaluation}", tag = "evaluations",
    params(("evaluation" = String, Path, description = "The evaluation's id.")),
    responses(
        (status = 200, body = Evaluation), (status = 400, body = Problem), (status = 404, body = Problem)
    )
)]
pub(in crate::http::v1) async fn get_evaluation(
    _: NoQuery,
    State(app): State<AppState>,
    Path(evaluation): Path<String>,
) -> Result<axum::Json<Evaluation>, Problem> {
    let EvaluationId { number, .. } = parse_id("evaluation", &evaluation)?;
    let mut conn = app.readers.acquire().await?;
    let row = evaluations::get(&mut conn, number).await?.ok_or(ServiceError::UnknownEvaluation(number))?;
    if row.state != EvaluationState::Complete {
        return Ok(axum::Json(Evaluation {
            summary: evaluation_summary(row, app.shards.own()),
            rows: Vec::new(),
        }));
    }
    let found = load_evaluation(&mut conn, number).await.map_err(ServiceError::from)?;
    drop(conn);
    let rows = run_blocking(move || Ok(report_evaluation(&found).map_err(ServiceError::from)?.rows)).await?;
    Ok(axum::Json(Evaluation { summary: evaluation_summary(row, app.shards.own()), rows }))
}
