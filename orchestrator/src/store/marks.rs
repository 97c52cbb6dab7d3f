//! What somebody should know of a run before trusting it.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// A mark as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkRow {
    /// A word for programs.
    pub kind: String,
    /// The lease it is about, and its token.
    pub lease: Option<i64>,
    /// The token of that lease.
    pub token: Option<String>,
    /// A sentence for people.
    pub words: String,
    /// When.
    pub at: Millis,
}

/// Marks a run.
///
/// # Errors
/// The database's.
pub async fn insert(
    conn: &mut SqliteConnection,
    run: &str,
    (kind, lease, words): (&str, Option<i64>, &str),
    at: Millis,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO run_marks (run, kind, lease, words, at) VALUES (?, ?, ?, ?, ?)",
        run,
        kind,
        lease,
        words,
        at
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// How many marks a run has, and the newest of them first.
///
/// # Errors
/// The database's.
pub async fn newest(
    conn: &mut SqliteConnection,
    run: &str,
    limit: i64,
) -> Result<(i64, Vec<MarkRow>), StoreError> {
    let all = sqlx::query_scalar!(r#"SELECT count(*) AS "n!: i64" FROM run_marks WHERE run = ?"#, run)
        .fetch_one(&mut *conn)
        .await?;
    let rows = sqlx::query_as!(
        MarkRow,
        r#"SELECT m.kind, m.lease, l.token AS "token?", m.words, m.at
           FROM run_marks m LEFT JOIN leases l ON l.id = m.lease WHERE m.run = ? ORDER BY m.id DESC LIMIT ?"#,
        run,
        limit
    )
    .fetch_all(conn)
    .await?;
    Ok((all, rows))
}
