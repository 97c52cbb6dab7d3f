//! Evaluations, the newest first.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::super::extract::Query;
use super::super::super::problem::Problem;
use super::super::{Page, next};
use super::view::Evaluation;
use crate::http::state::AppState;
use crate::store::evaluations;

/// A page of evaluations.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Evaluations {
    /// The newest first.
    evaluations: Vec<Evaluation>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// List evaluations, the newest first.
#[utoipa::path(
    get, path = "/evaluations", tag = "evaluations", params(Page),
    responses((status = 200, body = Evaluations), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(in crate::http::v1) async fn list(
    State(app): State<AppState>,
    Query(page): Query<Page>,
) -> Result<axum::Json<Evaluations>, Problem> {
    let limit = page.limit()?;
    let before = if page.cursor.is_some() { page.cursor()?.0 } else { i64::MAX };
    let mut conn = app.readers.acquire().await?;
    let rows = evaluations::page(&mut conn, before, limit).await?;
    let next = next(rows.len(), limit, rows.last().map(|row| (row.id, "")));
    Ok(axum::Json(Evaluations { evaluations: rows.into_iter().map(Evaluation::from).collect(), next }))
}
