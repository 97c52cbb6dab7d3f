//! Events of runs, a ring for each run. Tables `run_events` and `deleted_run_events`.

use sqlx::{SqliteConnection, query};

use super::{StoreError, text_enum, to_json};
use crate::Millis;

/// Events of a run that are always kept.
pub const MIN_EVENTS_KEPT: i64 = 10_000;

text_enum! {
    /// Subject of an event.
    pub enum EventKind: "an event's kind" {
        /// About the run itself.
        Run = "run",
        /// About one of its leases.
        Lease = "lease",
        /// A group that closed.
        Group = "group",
        /// About a level move.
        Move = "move",
        /// A claim of columns.
        Claim = "claim",
        /// About episodes that were criticised.
        Failures = "failures",
        /// About a design request.
        Design = "design",
        /// About workers on other machines that come and go.
        Worker = "worker",
        /// About a new warning.
        Warning = "warning",
    }
}

/// Row of the `run_events` table, without its run.
#[derive(Debug, Clone, PartialEq)]
pub struct EventRow {
    /// Number of the event. Numbers increase over all runs.
    pub id: i64,
    /// Subject of the event.
    pub kind: EventKind,
    /// The body as JSON.
    pub body: String,
    /// When the event happened.
    pub at: Millis,
}

/// An event to be stored.
#[derive(Debug, Clone, PartialEq)]
pub struct NewEvent {
    /// Id of the run.
    pub run: String,
    /// Subject of the event.
    pub kind: EventKind,
    /// The body as JSON.
    pub body: String,
    /// When the event happened.
    pub at: Millis,
}

/// Kind and time of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LastEvent {
    /// Subject of the event.
    pub kind: EventKind,
    /// When the event happened.
    pub at: Millis,
}

/// Stores events in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn append(conn: &mut SqliteConnection, events: &[NewEvent]) -> Result<(), StoreError> {
    let rows: Vec<_> = events.iter().map(|event| (&event.run, event.kind, &event.body, event.at)).collect();
    let rows = to_json(&rows)?;
    query!(
        "INSERT INTO run_events (run, kind, body, at)
         SELECT value ->> 0, value ->> 1, value ->> 2, value ->> 3 FROM json_each(?) ORDER BY key",
        rows
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Deletes the events of a run that are past its ring.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn trim(conn: &mut SqliteConnection, run: &str) -> Result<(), StoreError> {
    let last = sqlx::query_scalar!(
        "SELECT id FROM run_events WHERE run = ? ORDER BY id DESC LIMIT 1 OFFSET ?",
        run,
        MIN_EVENTS_KEPT
    )
    .fetch_optional(&mut *conn)
    .await?;
    let Some(last) = last else { return Ok(()) };
    query!("DELETE FROM run_events WHERE run = ? AND id <= ?", run, last).execute(&mut *conn).await?;
    query!(
        "INSERT INTO deleted_run_events (run, last_id) VALUES (?, ?)
         ON CONFLICT (run) DO UPDATE SET last_id = excluded.last_id",
        run,
        last
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads events of a run after a number, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn after(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<EventRow>, StoreError> {
    Ok(sqlx::query_as!(
        EventRow,
        r#"SELECT id, kind AS "kind: EventKind", body, at FROM run_events WHERE run = ? AND id > ? ORDER BY id LIMIT ?"#,
        run,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the number of the last event of a run that was deleted; 0 if none was. None if the run itself does not exist.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn last_deleted(conn: &mut SqliteConnection, run: &str) -> Result<Option<i64>, StoreError> {
    let last = sqlx::query_scalar!(
        r#"SELECT coalesce((SELECT last_id FROM deleted_run_events WHERE run = r.id), 0) AS "last!: i64"
           FROM runs r WHERE r.id = ? AND r.deleted_at IS NULL"#,
        run
    );
    Ok(last.fetch_optional(conn).await?)
}

/// Reads the number of the newest event of a run; 0 if there is none.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn newest(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(r#"SELECT coalesce(max(id), 0) AS "id!: i64" FROM run_events WHERE run = ?"#, run)
        .fetch_one(conn)
        .await?)
}

/// Reads the number of the event before the last `n` events of a run that have one of the kinds. If there are fewer, returns
/// the last deleted event.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn before_last(
    conn: &mut SqliteConnection,
    run: &str,
    kinds: &[EventKind],
    n: u32,
) -> Result<i64, StoreError> {
    let kinds = to_json(&kinds)?;
    let before = sqlx::query_scalar!(
        r#"SELECT id AS "id!: i64" FROM run_events WHERE run = ? AND kind IN (SELECT value FROM json_each(?))
           ORDER BY id DESC LIMIT 1 OFFSET ?"#,
        run,
        kinds,
        n
    );
    match before.fetch_optional(&mut *conn).await? {
        Some(id) => Ok(id),
        None => Ok(last_deleted(conn, run).await?.unwrap_or(0)),
    }
}

/// Reads kind and time of the newest event of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn last(conn: &mut SqliteConnection, run: &str) -> Result<Option<LastEvent>, StoreError> {
    Ok(sqlx::query_as!(
        LastEvent,
        r#"SELECT kind AS "kind: EventKind", at FROM run_events WHERE run = ? ORDER BY id DESC LIMIT 1"#,
        run
    )
    .fetch_optional(conn)
    .await?)
}
