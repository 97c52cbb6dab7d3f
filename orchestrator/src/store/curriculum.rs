//! Curriculum events, snapshots and level moves.

use sqlx::{SqliteConnection, query};

use super::{StoreError, to_json};
use crate::clock::Millis;

/// A level move as stored.
#[derive(Debug, Clone)]
pub struct MoveRow {
    /// The seq of the event that caused it.
    pub seq: i64,
    /// The task.
    pub task: String,
    /// `placement`, `up` or `down`.
    pub kind: String,
    /// From where.
    pub from_level: Option<i64>,
    /// To where.
    pub to_level: i64,
    /// JSON.
    pub evidence: String,
    /// When.
    pub at: Millis,
}

/// An event to be stored: its seq, its JSON, when.
pub type Event = (i64, String, Millis);

/// Appends events.
///
/// # Errors
/// The database's; a seq that is taken among them.
pub async fn append(conn: &mut SqliteConnection, run: &str, events: &[Event]) -> Result<(), StoreError> {
    let events = to_json(&events)?;
    query!(
        "INSERT INTO curriculum_events (run, seq, body, at)
         SELECT ?, value ->> 0, value ->> 1, value ->> 2 FROM json_each(?)",
        run,
        events
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Events from a seq on, in order, a page at a time.
///
/// # Errors
/// The database's.
pub async fn events(
    conn: &mut SqliteConnection,
    run: &str,
    from: i64,
    limit: i64,
) -> Result<Vec<(i64, String)>, StoreError> {
    let rows = query!(
        "SELECT seq, body FROM curriculum_events WHERE run = ? AND seq >= ? ORDER BY seq LIMIT ?",
        run,
        from,
        limit
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.seq, row.body)).collect())
}

/// Stores a snapshot, and drops all but the two newest.
///
/// # Errors
/// The database's.
pub async fn save_snapshot(
    conn: &mut SqliteConnection,
    run: &str,
    seq: i64,
    body: &str,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO curriculum_snapshots (run, seq, body) VALUES (?, ?, ?) ON CONFLICT (run, seq) DO NOTHING",
        run,
        seq,
        body
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "DELETE FROM curriculum_snapshots WHERE run = ?1 AND seq NOT IN
         (SELECT seq FROM curriculum_snapshots WHERE run = ?1 ORDER BY seq DESC LIMIT 2)",
        run
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// The newest snapshot: its seq and JSON.
///
/// # Errors
/// The database's.
pub async fn newest_snapshot(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<Option<(i64, String)>, StoreError> {
    let row =
        query!("SELECT seq, body FROM curriculum_snapshots WHERE run = ? ORDER BY seq DESC LIMIT 1", run)
            .fetch_optional(conn)
            .await?;
    Ok(row.map(|row| (row.seq, row.body)))
}

/// Stores a move.
///
/// # Errors
/// The database's.
pub async fn insert_move(conn: &mut SqliteConnection, run: &str, row: &MoveRow) -> Result<(), StoreError> {
    query!(
        "INSERT INTO level_moves (run, seq, task, kind, from_level, to_level, evidence, at)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
        run,
        row.seq,
        row.task,
        row.kind,
        row.from_level,
        row.to_level,
        row.evidence,
        row.at
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Moves in order after a seq.
///
/// # Errors
/// The database's.
pub async fn moves(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<MoveRow>, StoreError> {
    Ok(sqlx::query_as!(
        MoveRow,
        "SELECT seq, task, kind, from_level, to_level, evidence, at FROM level_moves
         WHERE run = ? AND seq > ? ORDER BY seq, task LIMIT ?",
        run,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Moves of a task after its proposal `first`, up to the first one after its proposal `last`.
///
/// # Errors
/// The database's.
pub async fn moves_about(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    (first, last): (i64, i64),
) -> Result<Vec<MoveRow>, StoreError> {
    Ok(sqlx::query_as!(
        MoveRow,
        "SELECT seq, task, kind, from_level, to_level, evidence, at FROM level_moves INDEXED BY moves_of_task
         WHERE run = ?1 AND task = ?2 AND seq > ?3 AND seq <= coalesce(
             (SELECT min(seq) FROM level_moves INDEXED BY moves_of_task WHERE run = ?1 AND task = ?2 AND seq > ?4), ?4)
         ORDER BY seq",
        run,
        task,
        first,
        last
    )
    .fetch_all(conn)
    .await?)
}
