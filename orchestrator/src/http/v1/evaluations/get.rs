//! One evaluation with its results.

use api_types::EvaluationSummary;
use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::super::blocking::run_blocking;
use super::super::super::extract::{NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::parse_id;
use super::view::evaluation_summary;
use crate::engine::error::ServiceError;
use crate::evaluation::read::{load_evaluation, report_evaluation};
use crate::evaluation::report::ReportRow;
use crate::http::state::AppState;
use crate::ids::EvaluationId;
use crate::store::evaluations::{self, EvaluationState};

/// Evaluation with its results.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Evaluation {
    /// The evaluation, as lists show it.
    #[serde(flatten)]
    summary: EvaluationSummary,
    /// Results of a complete evaluation and of the blind panel (`blind_panel`); empty before. A row for each task and part is `{task,
    /// part, policy, scenarios, score, success, skill, lost, fuel_used, cvar10}`. The last six are `{mean, low, high, scenarios}` with 95 %
    /// bootstrap intervals over scenarios.
    #[schema(value_type = Vec<Object>)]
    rows: Vec<ReportRow>,
}

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
    let EvaluationId(number) = parse_id("evaluation", &evaluation)?;
    let mut conn = app.readers.acquire().await?;
    let row = evaluations::get(&mut conn, number).await?.ok_or(ServiceError::UnknownEvaluation(number))?;
    if row.state != EvaluationState::Complete {
        return Ok(axum::Json(Evaluation { summary: evaluation_summary(row), rows: Vec::new() }));
    }
    let found = load_evaluation(&mut conn, number).await.map_err(ServiceError::from)?;
    drop(conn);
    let rows = run_blocking(move || Ok(report_evaluation(&found).map_err(ServiceError::from)?.rows)).await?;
    Ok(axum::Json(Evaluation { summary: evaluation_summary(row), rows }))
}
