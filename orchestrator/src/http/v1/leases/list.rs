//! List of a run's leases.

use api_types::{LeasePage, PageQuery};
use axum::Extension;
use axum::extract::State;
use store::{compacted_leases, leases};

use super::view::lease_summary;
use crate::http::access::Caller;
use crate::http::extract::{Path, Query};
use crate::http::paging::{PageCursor, next_cursor, page_limit};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;

/// List the leases of a run that belong to the principal of the token, oldest first.
///
/// An admin receives all leases. A page can have fewer leases than `limit`, or none: the list ends where `next` is null.
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
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    Query(page): Query<PageQuery>,
) -> Result<axum::Json<LeasePage>, Problem> {
    let (run, limit) = (parse_run_id(&run)?, page_limit(page.limit)?);
    let mut conn = acquire_run_reader(&app, &run).await?;
    let after = PageCursor::parse(page.cursor.as_deref())?.unwrap_or_default().number;
    let mut rows = leases::page(&mut conn, run.as_str(), after, limit).await?;
    rows.extend(compacted_leases::lease_rows(&mut conn, run.as_str(), after.saturating_add(1), limit).await?);
    rows.sort_by_key(|row| row.id);
    rows.dedup_by_key(|row| row.id); // a compacted lease can still have groups
    rows.truncate(usize::try_from(limit).unwrap_or_default());
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.id)));
    rows.retain(|row| caller.actor().may_use_lease(row.owner));
    Ok(axum::Json(LeasePage { leases: rows.into_iter().map(lease_summary).collect(), next }))
}
