//! Audit log: changes by API requests, and denied requests.

use api_types::{AuditLogEntry, AuditLogPage, AuditLogQuery};
use axum::extract::State;
use store::audit_log::{self, AuditRing, AuditRow};

use crate::http::extract::Query;
use crate::http::paging::{PageCursor, next_cursor, number_before, page_limit};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use clock::rfc3339;

/// List the entries of the audit log, newest first.
///
/// Entries are changes by API requests, or denied requests (401, 403) with `denied=true`. The server logs at most one denied
/// request a second for each address, and ten a second in all. It keeps the newest 100 000 changes and 20 000 denied requests.
#[utoipa::path(
    get, path = "/audit", tag = "access", params(AuditLogQuery),
    responses((status = 200, body = AuditLogPage), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list_audit_log(
    State(app): State<AppState>,
    Query(query): Query<AuditLogQuery>,
) -> Result<axum::Json<AuditLogPage>, Problem> {
    let limit = page_limit(query.limit)?;
    let before = number_before(query.cursor.as_deref())?;
    let mut conn = app.readers.acquire().await?;
    let ring = if query.denied { AuditRing::Denials } else { AuditRing::Changes };
    let rows = audit_log::page(&mut conn, ring, before, limit).await?;
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.id)));
    let entry = |row: AuditRow| AuditLogEntry {
        at: rfc3339(row.at),
        token: row.token,
        name: row.name,
        address: row.address,
        operation: row.operation,
        path: row.path,
        status: row.status,
        request_id: row.request_id,
    };
    Ok(axum::Json(AuditLogPage { entries: rows.into_iter().map(entry).collect(), next }))
}
