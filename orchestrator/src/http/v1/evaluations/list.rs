//! List of the evaluations of all runs.

use api_types::{EvaluationPage, PageQuery};
use axum::extract::State;
use store::evaluations;

use super::view::evaluation_summary;
use crate::http::extract::Query;
use crate::http::paging::{PageCursor, next_cursor, number_before, page_limit};
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// List evaluations, newest first.
#[utoipa::path(
    get, path = "/evaluations", tag = "evaluations", params(PageQuery),
    responses((status = 200, body = EvaluationPage), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(in crate::http::v1) async fn list_evaluations(
    State(app): State<AppState>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<EvaluationPage>, Problem> {
    let limit = page_limit(page.limit)?;
    let before = number_before(page.cursor.as_deref())?;
    let mut conn = app.readers.acquire().await?;
    let rows = evaluations::page(&mut conn, before, limit).await?;
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.id)));
    Ok(axum::Json(EvaluationPage { evaluations: rows.into_iter().map(evaluation_summary).collect(), next }))
}
