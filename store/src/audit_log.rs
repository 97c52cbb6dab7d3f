//! The audit log: requests that changed something by hand, and requests that were denied. Each has a ring of its own, so that
//! denied requests never displace changes. Tables `audit_log` and `denials`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::Millis;

/// Changes that are kept.
const MAX_CHANGES: i64 = 100_000;
/// Denied requests that are kept.
const MAX_DENIALS: i64 = 20_000;

/// Ring of the audit log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AuditRing {
    /// Requests that changed something by hand.
    Changes,
    /// Requests that were denied.
    Denials,
}

/// Row of either ring, with the name of its token.
#[derive(Debug, Clone)]
pub struct AuditRow {
    /// Number of the row; ignored when it is stored.
    pub id: i64,
    /// When the request arrived.
    pub at: Millis,
    /// Number of the token; none for anonymous requests.
    pub token: Option<i64>,
    /// Name of the token; ignored when the row is stored.
    pub name: Option<String>,
    /// Address of the client.
    pub address: Option<String>,
    /// Operation id of the API.
    pub operation: String,
    /// Path of the request.
    pub path: String,
    /// HTTP status of the response.
    pub status: i64,
    /// Id of the request.
    pub request_id: String,
}

/// Adds a row to a table, and deletes the rows past its ring.
macro_rules! append_to {
    ($conn:expr, $table:literal, $row:expr, $limit:expr) => {{
        query!(
            "INSERT INTO "
                + $table
                + " (at, token, address, operation, path, status, request_id) VALUES (?, ?, ?, ?, ?, ?, ?)",
            $row.at,
            $row.token,
            $row.address,
            $row.operation,
            $row.path,
            $row.status,
            $row.request_id
        )
        .execute(&mut *$conn)
        .await?;
        query!("DELETE FROM " + $table + " WHERE id <= (SELECT max(id) FROM " + $table + ") - ?", $limit)
            .execute($conn)
            .await?;
    }};
}

/// Selects the newest [`AuditRow`]s of a table below a number.
macro_rules! query_page {
    ($table:literal, $before:expr, $limit:expr) => {
        sqlx::query_as!(
            AuditRow,
            r#"SELECT a.id, a.at, a.token, t.name AS "name?", a.address, a.operation, a.path, a.status, a.request_id
               FROM "# + $table + " a LEFT JOIN tokens t ON t.id = a.token WHERE a.id < ? ORDER BY a.id DESC LIMIT ?",
            $before,
            $limit
        )
    };
}

/// Adds a row to a ring, and deletes the rows past the ring.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn append(conn: &mut SqliteConnection, ring: AuditRing, row: &AuditRow) -> Result<(), StoreError> {
    match ring {
        AuditRing::Changes => append_to!(conn, "audit_log", row, MAX_CHANGES),
        AuditRing::Denials => append_to!(conn, "denials", row, MAX_DENIALS),
    }
    Ok(())
}

/// Reads rows of a ring with numbers below `before`, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn page(
    conn: &mut SqliteConnection,
    ring: AuditRing,
    before: i64,
    limit: i64,
) -> Result<Vec<AuditRow>, StoreError> {
    Ok(match ring {
        AuditRing::Changes => query_page!("audit_log", before, limit).fetch_all(conn).await?,
        AuditRing::Denials => query_page!("denials", before, limit).fetch_all(conn).await?,
    })
}
