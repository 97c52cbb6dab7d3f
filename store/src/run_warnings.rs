//! Warnings that a user should see before trusting a run. Table `run_warnings`.

use sqlx::{SqliteConnection, query};

use super::{StoreError, text_enum};
use crate::Millis;

text_enum! {
    /// Reason of a warning.
    pub enum WarningKind: "the kind of a run warning" {
        /// An audited log did not replay as its columns claim.
        RefusedClaim = "refused_claim",
        /// Audited logs of a claim did not arrive before the lease ended.
        UnprovenClaim = "unproven_claim",
    }
}

/// A warning to be stored.
#[derive(Debug, Clone, Copy)]
pub struct NewWarning<'a> {
    /// Id of the run.
    pub run: &'a str,
    /// Reason of the warning.
    pub kind: WarningKind,
    /// Number of the lease that the warning is about.
    pub lease: Option<i64>,
    /// The warning in a sentence.
    pub message: &'a str,
}

/// Row of the `run_warnings` table, with the suffix of its lease id.
#[derive(Debug, Clone, PartialEq)]
pub struct RunWarningRow {
    /// Reason of the warning.
    pub kind: WarningKind,
    /// Number of the lease that the warning is about.
    pub lease: Option<i64>,
    /// Token of that lease.
    pub id_suffix: Option<String>,
    /// The warning in a sentence.
    pub message: String,
    /// When the warning was stored.
    pub at: Millis,
}

/// Warnings of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct RunWarnings {
    /// Number of all warnings.
    pub count: i64,
    /// The newest warnings, newest first.
    pub newest: Vec<RunWarningRow>,
}

/// Stores a warning.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert(
    conn: &mut SqliteConnection,
    warning: &NewWarning<'_>,
    at: Millis,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO run_warnings (run, kind, lease, message, at) VALUES (?, ?, ?, ?, ?)",
        warning.run,
        warning.kind,
        warning.lease,
        warning.message,
        at
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the number of a run's warnings, and the newest `limit` of them.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn newest(conn: &mut SqliteConnection, run: &str, limit: i64) -> Result<RunWarnings, StoreError> {
    let count = sqlx::query_scalar!(r#"SELECT count(*) AS "n!: i64" FROM run_warnings WHERE run = ?"#, run)
        .fetch_one(&mut *conn)
        .await?;
    let newest = sqlx::query_as!(
        RunWarningRow,
        r#"SELECT w.kind AS "kind: WarningKind", w.lease, l.id_suffix AS "id_suffix?", w.message, w.at
           FROM run_warnings w LEFT JOIN leases l ON l.id = w.lease WHERE w.run = ? ORDER BY w.id DESC LIMIT ?"#,
        run,
        limit
    )
    .fetch_all(conn)
    .await?;
    Ok(RunWarnings { count, newest })
}
