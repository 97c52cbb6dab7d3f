//! Comparison of evaluations.

use api_types::ComparisonQuery;
use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::super::blocking::run_blocking;
use super::super::super::extract::Query;
use super::super::super::problem::Problem;
use crate::engine::error::ServiceError;
use crate::evaluation::read::{
    LoadedEvaluation, MAX_SIDE_EVALUATIONS, SideComparison, compare_sides as compared, load_evaluation,
};
use crate::evaluation::report::ComparisonRow;
use crate::evaluation::seeds::AcrossSeeds;
use crate::http::state::AppState;
use crate::ids::{EvaluationId, InvalidId};

/// Comparison of two sides, each with one or more evaluations.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Comparison {
    /// Suite of all evaluations.
    suite: String,
    /// First side.
    a: ComparisonSide,
    /// Second side.
    b: ComparisonSide,
    /// Differences of the first side to the second on the same scenarios, over all trainings of a side. A row for each task and part is
    /// `{task, part, scenarios, score, success, skill, improvement}`. The last four are `{mean, low, high, scenarios}` with 95 % bootstrap
    /// intervals over scenarios. `improvement` is the probability that an episode of the first side scores higher; a tie counts one half.
    #[schema(value_type = Vec<Object>)]
    rows: Vec<ComparisonRow>,
}

/// Side of a comparison.
#[derive(Serialize, ToSchema)]
struct ComparisonSide {
    /// Ids of its evaluations.
    evaluations: Vec<String>,
    /// Interquartile means over its trainings of the mean score, success and skill on the suite: `{trainings, score, success, skill}`
    /// with 95 % bootstrap intervals over trainings. Intervals over fewer than three trainings are not informative.
    #[schema(value_type = Object)]
    across: AcrossSeeds,
}

/// Compare evaluations of one suite: paired by scenario, and across trainings if a side has several.
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
            format!("{} evaluations; at most {MAX_SIDE_EVALUATIONS} are taken", ids.len()),
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
