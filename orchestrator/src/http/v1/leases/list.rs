//! List of a run's leases.

use api_types::{LeasePage, PageQuery};
use axum::extract::State;

use super::super::super::extract::{Path, Query};
use super::super::super::problem::Problem;
use super::super::{Cursor, next_cursor, page_limit, reader_of_run, run_id};
use super::view::lease_summary;
use crate::http::state::AppState;
use crate::store::{compacted_leases, leases};

/// List the leases of a run, oldest first.
#[utoipa::path(
    get, path = "/runs/{run}/leases", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), PageQuery),
    responses(
        (status = 200, body = LeasePage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn list_leases(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<LeasePage>, Problem> {
    let (run, limit) = (run_id(&run)?, page_limit(page.limit)?);
    let mut conn = reader_of_run(&app, &run).await?;
    let after = Cursor::parse(page.cursor.as_deref())?.unwrap_or_default().number;
    let mut rows = leases::page(&mut conn, run.as_str(), after, limit).await?;
    rows.extend(compacted_leases::heads(&mut conn, run.as_str(), after.saturating_add(1), limit).await?);
    rows.sort_by_key(|row| row.id);
    rows.dedup_by_key(|row| row.id); // a compacted lease can still have groups
    rows.truncate(usize::try_from(limit).unwrap_or_default());
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| (row.id, "")));
    Ok(axum::Json(LeasePage { leases: rows.into_iter().map(lease_summary).collect(), next }))
}
