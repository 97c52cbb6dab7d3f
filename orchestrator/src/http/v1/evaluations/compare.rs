//! Comparison of evaluations of one suite.

use api_types::{Comparison, ComparisonQuery, ComparisonSide};
use axum::extract::State;
use store::ids::{EvaluationId, InvalidId};

use crate::engine::error::ServiceError;
use crate::evaluations::read::{
    LoadedEvaluation, MAX_SIDE_EVALUATIONS, SideComparison, compare_sides as compared, load_evaluation,
};
use crate::http::blocking::run_blocking;
use crate::http::extract::Query;
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// Compare two sides of evaluations of one suite.
///
/// Differences are paired by scenario. If a side has several trainings, the response also has estimates across its trainings.
#[utoipa::path(
    get, path = "/evaluations/compare", tag = "evaluations", params(ComparisonQuery),
    responses(
        (status = 200, body = Comparison), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn compare_evaluations(
    State(app): State<AppState>,
    Query(query): Query<ComparisonQuery>,
) -> Result<axum::Json<Comparison>, Problem> {
    let (a, b) = (read_side(&app, "a", &query.a).await?, read_side(&app, "b", &query.b).await?);
    let names =
        |side: &[LoadedEvaluation]| side.iter().map(|found| EvaluationId(found.row.id).to_string()).collect();
    let (one, other): (Vec<String>, Vec<String>) = (names(&a), names(&b));
    let SideComparison { report, first: across_a, second: across_b } =
        run_blocking(move || Ok(compared(&a, &b).map_err(ServiceError::from)?)).await?;
    Ok(axum::Json(Comparison {
        suite: report.suite,
        a: ComparisonSide { evaluations: one, across: across_a },
        b: ComparisonSide { evaluations: other, across: across_b },
        rows: report.comparisons,
    }))
}

/// Reads the evaluations whose ids a query field lists.
async fn read_side(app: &AppState, field: &str, text: &str) -> Result<Vec<LoadedEvaluation>, Problem> {
    let ids: Vec<&str> = text.split(',').map(str::trim).collect();
    if ids.len() > MAX_SIDE_EVALUATIONS {
        return Err(Problem::invalid(
            field,
            format!("must list at most {MAX_SIDE_EVALUATIONS} evaluations, got {}", ids.len()),
        ));
    }
    let mut conn = app.readers.acquire().await?;
    let mut all = Vec::with_capacity(ids.len());
    for text in ids {
        let EvaluationId(number) =
            text.parse().map_err(|error: InvalidId| Problem::invalid(field, error.to_string()))?;
        all.push(load_evaluation(&mut conn, number).await.map_err(ServiceError::from)?);
    }
    Ok(all)
}
