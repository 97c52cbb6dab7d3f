//! Comparison of evaluations of one suite.

use api_types::{Comparison, ComparisonQuery, ComparisonSide};
use axum::extract::{RawQuery, State};
use axum::http::HeaderMap;
use store::ids::{EvaluationId, InvalidId};
use store::shard::Shard;

use crate::engine::error::ServiceError;
use crate::evaluations::read::{
    LoadedEvaluation, MAX_SIDE_EVALUATIONS, SideComparison, compare_sides as compared, load_evaluation,
};
use crate::http::blocking::run_blocking;
use crate::http::extract::Query;
use crate::http::problem::Problem;
use crate::http::shard_routing::{ForwardedRequest, common_shard, forward};
use crate::http::state::AppState;

/// Compare two sides of evaluations of one suite.
///
/// Differences are paired by scenario. If a side has several trainings, the response also has estimates across its trainings. All
/// evaluations are of one shard.
#[utoipa::path(
    get, path = "/evaluations/compare", tag = "evaluations", params(ComparisonQuery),
    responses(
        (status = 200, body = Comparison), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn compare_evaluations(
    State(app): State<AppState>,
    headers: HeaderMap,
    RawQuery(raw): RawQuery,
    Query(query): Query<ComparisonQuery>,
) -> Result<axum::Json<Comparison>, Problem> {
    if let Some(own) = app.shards.own() {
        let shard = common_shard("b", own, ids_of(&query.a).chain(ids_of(&query.b)))?;
        let path = format!("/v1/evaluations/compare?{}", raw.unwrap_or_default());
        if let Some(found) = forward(&app, &headers, Some(&shard), ForwardedRequest::get(&path)).await? {
            return Ok(axum::Json(found));
        }
        check_shard(own, &shard)?;
    }
    let (a, b) = (read_side(&app, "a", &query.a).await?, read_side(&app, "b", &query.b).await?);
    let name = |number| EvaluationId { shard: app.shards.own().cloned(), number }.to_string();
    let names = |side: &[LoadedEvaluation]| side.iter().map(|found| name(found.row.id)).collect();
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

/// Returns the ids that a query field lists.
fn ids_of(text: &str) -> impl Iterator<Item = &str> {
    text.split(',').map(str::trim)
}

/// Checks that evaluations of a shard are on this server.
fn check_shard(own: &Shard, shard: &Shard) -> Result<(), Problem> {
    if shard == own {
        return Ok(());
    }
    Err(Problem::invalid("a", format!("is of the shard {shard}, which is no peer of the shard {own}")))
}

/// Reads the evaluations whose ids a query field lists.
async fn read_side(app: &AppState, field: &str, text: &str) -> Result<Vec<LoadedEvaluation>, Problem> {
    let ids: Vec<&str> = ids_of(text).collect();
    if ids.len() > MAX_SIDE_EVALUATIONS {
        return Err(Problem::invalid(
            field,
            format!("must list at most {MAX_SIDE_EVALUATIONS} evaluations, got {}", ids.len()),
        ));
    }
    let mut conn = app.readers.acquire().await?;
    let mut all = Vec::with_capacity(ids.len());
    for text in ids {
        let EvaluationId { number, .. } =
            text.parse().map_err(|error: InvalidId| Problem::invalid(field, error.to_string()))?;
        all.push(load_evaluation(&mut conn, number).await.map_err(ServiceError::from)?);
    }
    Ok(all)
}
