//! Listing leases.

use axum::extract::State;
use serde::Serialize;
use utoipa::ToSchema;

use super::super::super::extract::{Path, Query};
use super::super::super::problem::Problem;
use super::super::{Page, next, reader_of, run_id};
use super::view::LeaseHead;
use crate::http::state::AppState;
use crate::store::{compacted_leases, leases};

/// A page of leases.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Leases {
    /// Oldest first.
    leases: Vec<LeaseHead>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// List the leases of a run, oldest first.
#[utoipa::path(
    get, path = "/runs/{run}/leases", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), Page),
    responses(
        (status = 200, body = Leases), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn list(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(page): Query<Page>,
) -> Result<axum::Json<Leases>, Problem> {
    let (run, limit) = (run_id(&run)?, page.limit()?);
    let mut conn = reader_of(&app, &run).await?;
    let after = page.cursor()?.0;
    let mut rows = leases::page(&mut conn, run.as_str(), after, limit).await?;
    rows.extend(compacted_leases::heads(&mut conn, run.as_str(), after.saturating_add(1), limit).await?);
    rows.sort_by_key(|row| row.id);
    rows.dedup_by_key(|row| row.id); // something of it stays
    rows.truncate(usize::try_from(limit).unwrap_or_default());
    let next = next(rows.len(), limit, rows.last().map(|row| (row.id, "")));
    Ok(axum::Json(Leases { leases: rows.into_iter().map(LeaseHead::of).collect(), next }))
}
