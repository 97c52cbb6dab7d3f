//! Events, snapshots and level moves of curricula. Tables `curriculum_events`, `curriculum_snapshots` and `level_moves`.

use sqlx::{SqliteConnection, query};

use super::{StoreError, text_enum, to_json};
use crate::Millis;

text_enum! {
    /// Direction of a level move.
    pub enum LevelMoveKind: "the kind of a level move" {
        /// Placement ended, and the run starts at this level.
        Placement = "placement",
        /// A move one level up.
        Up = "up",
        /// A move one level down.
        Down = "down",
    }
}

/// Row of the `level_moves` table, without its run.
#[derive(Debug, Clone)]
pub struct LevelMoveRow {
    /// Sequence number of the event that caused the move.
    pub seq: i64,
    /// Task whose level moved.
    pub task: String,
    /// Direction of the move.
    pub kind: LevelMoveKind,
    /// Level before the move; none for a placement.
    pub from_level: Option<i64>,
    /// Level after the move.
    pub to_level: i64,
    /// The evidence as JSON.
    pub evidence: String,
    /// When the level moved.
    pub at: Millis,
}

/// An event to be stored.
#[derive(Debug, Clone)]
pub struct NewCurriculumEvent {
    /// Sequence number of the event in its run.
    pub seq: i64,
    /// The event as JSON.
    pub body: String,
    /// When the event happened.
    pub at: Millis,
}

/// An event or a snapshot as it is stored.
#[derive(Debug, Clone)]
pub struct CurriculumRecord {
    /// Sequence number of the event; of a snapshot, that of the next event.
    pub seq: i64,
    /// Event or snapshot as JSON.
    pub body: String,
}

/// Appends events to a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails, for example because a sequence number is taken.
pub async fn append(
    conn: &mut SqliteConnection,
    run: &str,
    events: &[NewCurriculumEvent],
) -> Result<(), StoreError> {
    let events: Vec<_> = events.iter().map(|event| (event.seq, &event.body, event.at)).collect();
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

/// Reads events of a run from a sequence number on, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn events(
    conn: &mut SqliteConnection,
    run: &str,
    from: i64,
    limit: i64,
) -> Result<Vec<CurriculumRecord>, StoreError> {
    Ok(sqlx::query_as!(
        CurriculumRecord,
        "SELECT seq, body FROM curriculum_events WHERE run = ? AND seq >= ? ORDER BY seq LIMIT ?",
        run,
        from,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Sequence numbers of the events that are stored of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EventRange {
    /// Sequence number of the first event; `None` if there is no event.
    pub first: Option<i64>,
    /// Sequence number of the last event; `None` if there is no event.
    pub last: Option<i64>,
    /// Number of events that are stored.
    pub count: i64,
}

/// Reads the range of the stored events of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn event_range(conn: &mut SqliteConnection, run: &str) -> Result<EventRange, StoreError> {
    Ok(sqlx::query_as!(
        EventRange,
        r#"SELECT min(seq) AS "first: i64", max(seq) AS "last: i64", count(*) AS "count!: i64"
           FROM curriculum_events WHERE run = ?"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Stores a snapshot, and deletes all but the two newest of the run.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
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

/// Reads the newest snapshot of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn newest_snapshot(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<Option<CurriculumRecord>, StoreError> {
    Ok(sqlx::query_as!(
        CurriculumRecord,
        "SELECT seq, body FROM curriculum_snapshots WHERE run = ? ORDER BY seq DESC LIMIT 1",
        run
    )
    .fetch_optional(conn)
    .await?)
}

/// Reads the snapshots of a run, oldest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn snapshots(conn: &mut SqliteConnection, run: &str) -> Result<Vec<CurriculumRecord>, StoreError> {
    Ok(sqlx::query_as!(
        CurriculumRecord,
        "SELECT seq, body FROM curriculum_snapshots WHERE run = ? ORDER BY seq",
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Stores a level move.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert_move(
    conn: &mut SqliteConnection,
    run: &str,
    row: &LevelMoveRow,
) -> Result<(), StoreError> {
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

/// Reads moves of a run after a sequence number, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn moves(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<LevelMoveRow>, StoreError> {
    Ok(sqlx::query_as!(
        LevelMoveRow,
        r#"SELECT seq, task, kind AS "kind: LevelMoveKind", from_level, to_level, evidence, at FROM level_moves
           WHERE run = ? AND seq > ? ORDER BY seq, task LIMIT ?"#,
        run,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the moves of a task that may rest on its proposals `first` to `last`: those after the first proposal, up to the first
/// move after the last one.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn moves_around(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    first: i64,
    last: i64,
) -> Result<Vec<LevelMoveRow>, StoreError> {
    Ok(sqlx::query_as!(
        LevelMoveRow,
        r#"SELECT seq, task, kind AS "kind: LevelMoveKind", from_level, to_level, evidence, at
           FROM level_moves INDEXED BY level_moves_of_task
           WHERE run = ?1 AND task = ?2 AND seq > ?3 AND seq <= coalesce(
               (SELECT min(seq) FROM level_moves INDEXED BY level_moves_of_task WHERE run = ?1 AND task = ?2 AND seq > ?4), ?4)
           ORDER BY seq"#,
        run,
        task,
        first,
        last
    )
    .fetch_all(conn)
    .await?)
}
