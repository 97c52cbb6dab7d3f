//! What happened in runs, in order: a ring for each.

use sqlx::{SqliteConnection, query};

use super::{StoreError, to_json};
use crate::clock::Millis;

/// Events that are kept of a run, at least.
pub const KEPT: i64 = 10_000;

/// An event as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct EventRow {
    /// Its number: higher is later, over all runs.
    pub id: i64,
    /// What kind it is of.
    pub kind: String,
    /// JSON.
    pub body: String,
    /// When.
    pub at: Millis,
}

/// An event to be stored: of which run, its kind, its JSON, when.
pub type Told = (String, &'static str, String, Millis);

/// Stores events, in order.
///
/// # Errors
/// The database's.
pub async fn append(conn: &mut SqliteConnection, told: &[Told]) -> Result<(), StoreError> {
    let told = to_json(&told)?;
    query!(
        "INSERT INTO run_events (run, kind, body, at)
         SELECT value ->> 0, value ->> 1, value ->> 2, value ->> 3 FROM json_each(?) ORDER BY key",
        told
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Forgets what is past the ring.
///
/// # Errors
/// The database's.
pub async fn trim(conn: &mut SqliteConnection, run: &str) -> Result<(), StoreError> {
    let last = sqlx::query_scalar!(
        "SELECT id FROM run_events WHERE run = ? ORDER BY id DESC LIMIT 1 OFFSET ?",
        run,
        KEPT
    )
    .fetch_optional(&mut *conn)
    .await?;
    let Some(last) = last else { return Ok(()) };
    query!("DELETE FROM run_events WHERE run = ? AND id <= ?", run, last).execute(&mut *conn).await?;
    query!(
        "INSERT INTO forgotten_events (run, last) VALUES (?, ?) ON CONFLICT (run) DO UPDATE SET last = excluded.last",
        run,
        last
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Events of a run after a number, in order.
///
/// # Errors
/// The database's.
pub async fn after(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<EventRow>, StoreError> {
    Ok(sqlx::query_as!(
        EventRow,
        "SELECT id, kind, body, at FROM run_events WHERE run = ? AND id > ? ORDER BY id LIMIT ?",
        run,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// The last event of a run that was forgotten; 0 where none was.
///
/// # Errors
/// The database's.
pub async fn forgotten(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    let last = sqlx::query_scalar!("SELECT last FROM forgotten_events WHERE run = ?", run);
    Ok(last.fetch_optional(conn).await?.unwrap_or(0))
}

/// The newest event of a run; 0 where there is none.
///
/// # Errors
/// The database's.
pub async fn newest(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(r#"SELECT coalesce(max(id), 0) AS "id!: i64" FROM run_events WHERE run = ?"#, run)
        .fetch_one(conn)
        .await?)
}

/// The event before the last `n` of a run; where there are no more of them, the one before the first that is kept.
///
/// # Errors
/// The database's.
pub async fn before_last(conn: &mut SqliteConnection, run: &str, n: u32) -> Result<i64, StoreError> {
    let before = sqlx::query_scalar!(
        r#"SELECT id AS "id!: i64" FROM run_events WHERE run = ? ORDER BY id DESC LIMIT 1 OFFSET ?"#,
        run,
        n
    );
    match before.fetch_optional(&mut *conn).await? {
        Some(id) => Ok(id),
        None => forgotten(conn, run).await,
    }
}

/// The kind of a run's newest event, and when it was.
///
/// # Errors
/// The database's.
pub async fn last(conn: &mut SqliteConnection, run: &str) -> Result<Option<(String, Millis)>, StoreError> {
    let row = query!("SELECT kind, at FROM run_events WHERE run = ? ORDER BY id DESC LIMIT 1", run);
    Ok(row.fetch_optional(conn).await?.map(|row| (row.kind, row.at)))
}
