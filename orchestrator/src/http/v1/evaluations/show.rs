//! One evaluation with its numbers.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::super::extract::{NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::super::room::aside;
use super::super::id;
use super::view::Evaluation;
use crate::evaluation::report::ReportRow;
use crate::ids::EvaluationId;
use crate::http::state::AppState;
use crate::store::evaluations::{self, EvaluationState};
use crate::engine::error::ServiceError;
use crate::evaluation::read::{read, report};

/// An evaluation.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct EvaluationFound {
    /// What it is.
    #[serde(flatten)]
    head: Evaluation,
    /// What was found, once it is complete, beside the plans that look at nothing (`blind_panel`): for each task and part `{task, part,
    /// policy, scenarios, score, success, skill, lost, fuel_used, cvar10}`, the last six as `{mean, low, high, scenarios}`, 95 % bootstrap
    /// intervals over scenarios.
    #[schema(value_type = Vec<Object>)]
    rows: Vec<ReportRow>,
}

/// Show an evaluation, with what it found once it is complete.
#[utoipa::path(
    get, path = "/evaluations/{evaluation}", tag = "evaluations",
    params(("evaluation" = String, Path, description = "The evaluation's id.")),
    responses(
        (status = 200, body = EvaluationFound), (status = 400, body = Problem), (status = 404, body = Problem)
    )
)]
pub(in crate::http::v1) async fn show(
    _: NoQuery,
    State(app): State<AppState>,
    Path(evaluation): Path<String>,
) -> Result<axum::Json<EvaluationFound>, Problem> {
    let EvaluationId(number) = id("evaluation", &evaluation)?;
    let mut conn = app.readers.acquire().await?;
    let row = evaluations::get(&mut conn, number).await?.ok_or(ServiceError::UnknownEvaluation(number))?;
    if row.state != EvaluationState::Complete {
        return Ok(axum::Json(EvaluationFound { head: row.into(), rows: Vec::new() }));
    }
    let found = read(&mut conn, number).await.map_err(ServiceError::from)?;
    drop(conn);
    let told = aside(move || Ok(report(&found).map_err(ServiceError::from)?.rows)).await?;
    let rows = told.into_iter().collect();
    Ok(axum::Json(EvaluationFound { head: row.into(), rows }))
}
