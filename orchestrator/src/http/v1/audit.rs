//! The audit log: what was changed by hand, and who was kept out.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::super::extract::Query;
use super::super::problem::Problem;
use super::{Page, next};
use crate::clock::rfc3339;
use crate::http::state::AppState;
use crate::store::audit_log::{self, AuditRing, AuditRow};

/// A line of the audit log.
#[derive(Serialize, ToSchema)]
struct AuditLine {
    /// When, RFC 3339.
    at: String,
    /// The number of the token; none where nobody showed one that is known.
    token: Option<i64>,
    /// Its name.
    name: Option<String>,
    /// The address it came from.
    address: Option<String>,
    /// The operation, as this document names it.
    #[schema(example = "POST /v1/runs/{run}/pause")]
    operation: String,
    /// The path that was asked for.
    path: String,
    /// The HTTP status it was answered with.
    status: i64,
    /// The request's id, which stands in the logs, too.
    request_id: String,
}

/// A page of the audit log.
#[derive(Serialize, ToSchema)]
pub(super) struct AuditLog {
    /// The newest first.
    lines: Vec<AuditLine>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// Which lines.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct Which {
    /// Those about who was kept out, instead of what was changed (false).
    #[serde(default)]
    denied: bool,
    /// How many at most: 1 to 500 (50).
    limit: Option<u32>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// Show what was changed by hand; or, with `denied=true`, who was kept out (401, 403; a line a second of an address at most, and ten of
/// all). The newest 100 000 lines are kept, of who was kept out 20 000.
#[utoipa::path(
    get, path = "/audit", tag = "health", operation_id = "audit", params(Which),
    responses((status = 200, body = AuditLog), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list(
    State(app): State<AppState>,
    Query(Which { denied, limit, cursor }): Query<Which>,
) -> Result<axum::Json<AuditLog>, Problem> {
    let page = Page { limit, cursor };
    let limit = page.limit()?;
    let before = if page.cursor.is_some() { page.cursor()?.0 } else { i64::MAX };
    let mut conn = app.readers.acquire().await?;
    let ring = if denied { AuditRing::Denials } else { AuditRing::Changes };
    let rows = audit_log::page(&mut conn, ring, before, limit).await?;
    let next = next(rows.len(), limit, rows.last().map(|row| (row.id, "")));
    let line = |row: AuditRow| AuditLine {
        at: rfc3339(row.at),
        token: row.token,
        name: row.name,
        address: row.address,
        operation: row.operation,
        path: row.path,
        status: row.status,
        request_id: row.request_id,
    };
    Ok(axum::Json(AuditLog { lines: rows.into_iter().map(line).collect(), next }))
}
