//! List of the evaluations of all runs.

use api_types::{EvaluationPage, EvaluationSummary, PageQuery};
use axum::extract::State;
use axum::http::HeaderMap;
use store::evaluations;
use store::ids::EvaluationId;

use super::view::evaluation_summary;
use crate::http::extract::Query;
use crate::http::paging::{PageCursor, next_cursor, number_before, page_limit};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::http::v1::numbered_list::{NumberedQuery, list_of_shards, own_number, parse_shard_cursor};
use crate::shards::merge::NumberedItem;

/// List evaluations, newest first.
///
/// A server with peers lists the evaluations of all shards.
#[utoipa::path(
    get, path = "/evaluations", tag = "evaluations", params(PageQuery),
    responses((status = 200, body = EvaluationPage), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(in crate::http::v1) async fn list_evaluations(
    State(app): State<AppState>,
    headers: HeaderMap,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<EvaluationPage>, Problem> {
    let limit = page_limit(page.limit)?;
    if !app.shards.is_merged(&headers) {
        let before = number_before(page.cursor.as_deref())?;
        return Ok(axum::Json(list_own_evaluations(&app, before, limit).await?));
    }
    let cursor = parse_shard_cursor(page.cursor.as_deref())?;
    let own = list_own_evaluations(&app, own_number(&app, &cursor), limit).await?;
    let query = NumberedQuery { path: "/v1/evaluations", filters: String::new(), limit, cursor };
    let listed = list_of_shards(&app, &headers, query, own, numbered, |page| page.next.is_some()).await;
    let (evaluations, next) = (listed.merged.items, listed.merged.next);
    Ok(axum::Json(EvaluationPage { evaluations, next, missing_shards: listed.missing }))
}

/// Reads a page of the evaluations of this server.
async fn list_own_evaluations(app: &AppState, before: i64, limit: i64) -> Result<EvaluationPage, Problem> {
    let mut conn = app.readers.acquire().await?;
    let rows = evaluations::page(&mut conn, before, limit).await?;
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.id)));
    let evaluations = rows.into_iter().map(|row| evaluation_summary(row, app.shards.own())).collect();
    Ok(EvaluationPage { evaluations, next, missing_shards: Vec::new() })
}

/// Returns the evaluations of a page with their numbers, without those whose id cannot be read.
fn numbered(page: EvaluationPage) -> Vec<NumberedItem<EvaluationSummary>> {
    let number = |item: EvaluationSummary| {
        let EvaluationId { number, .. } = item.id.parse().ok()?;
        Some(NumberedItem { at: item.created_at.clone(), number, item })
    };
    page.evaluations.into_iter().filter_map(number).collect()
}
