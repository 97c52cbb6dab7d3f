//! Learning curves as they are stored: the latest buckets of a task in `task_curves`, a row each, and earlier ones in
//! `task_curve_blocks`, [`BLOCK_BUCKETS`] to a row. A bucket has about a kilobyte of JSON, so that a row of its own takes two pages of
//! the database, which a disk may have to look for; packed, a page has many.

use sqlx::{QueryBuilder, SqliteConnection, query, query_as};

use super::super::pack::{pack, unpack};
use super::super::{MAX_ROWS, StoreError, from_json, to_json};
use super::curve_point::CurvePoint;
use crate::Millis;

/// Consecutive buckets of a block.
const BLOCK_BUCKETS: i64 = 32;
/// Name of a block in error messages.
const BLOCK_ITEM: &str = "a block of a learning curve";

/// A bucket of a curve with its place, without its run and task.
#[derive(Debug, Clone)]
pub(super) struct CurveRow {
    /// Number of the bucket, from 0.
    pub(super) ordinal: i64,
    /// Episodes after which the next bucket begins.
    pub(super) width: i64,
    /// Results in the bucket.
    pub(super) point: CurvePoint,
}

/// Reads the last bucket of a task.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails, and [`StoreError::Corrupt`] if the bucket is damaged.
pub(super) async fn last_row(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Option<CurveRow>, StoreError> {
    let row = query_as!(
        StoredRow,
        "SELECT ordinal, width, first_episode, episodes, first_step, first_at, last_at, results FROM task_curves
         WHERE run = ?1 AND task = ?2 ORDER BY ordinal DESC LIMIT 1",
        run,
        task
    )
    .fetch_optional(conn)
    .await?;
    row.map(StoredRow::read).transpose()
}

/// Reads all buckets of a task, in order of time.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails, and [`StoreError::Corrupt`] if a bucket is damaged.
pub(super) async fn read_points(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Vec<CurvePoint>, StoreError> {
    let blocks =
        query!("SELECT points FROM task_curve_blocks WHERE run = ?1 AND task = ?2 ORDER BY block", run, task)
            .fetch_all(&mut *conn)
            .await?;
    let mut points = Vec::new();
    for block in blocks {
        points.extend(read_block(&block.points)?);
    }
    points.extend(read_rows(conn, run, task).await?.into_iter().map(|row| row.point));
    Ok(points)
}

/// Writes a bucket, in place of the one with the same ordinal. The first bucket after a block packs those before it.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails, and [`StoreError::Corrupt`] if an earlier bucket is damaged.
pub(super) async fn write_row(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    row: CurveRow,
) -> Result<(), StoreError> {
    let ordinal = row.ordinal;
    insert_rows(&mut *conn, run, task, &[row]).await?;
    if ordinal > 0 && ordinal % BLOCK_BUCKETS == 0 {
        pack_rows(conn, run, task, ordinal).await
    } else {
        Ok(())
    }
}

/// Writes all buckets of a task, in place of those that it has.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails, and [`StoreError::Corrupt`] if a bucket has no JSON form.
pub(super) async fn replace_rows(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    rows: &[CurveRow],
) -> Result<(), StoreError> {
    query!("DELETE FROM task_curve_blocks WHERE run = ?1 AND task = ?2", run, task)
        .execute(&mut *conn)
        .await?;
    query!("DELETE FROM task_curves WHERE run = ?1 AND task = ?2", run, task).execute(&mut *conn).await?;
    for rows in rows.chunks(MAX_ROWS) {
        insert_rows(&mut *conn, run, task, rows).await?;
    }
    // The last bucket keeps its row, since it may still grow.
    let last = rows.last().map_or(0, |row| row.ordinal);
    pack_rows(conn, run, task, last / BLOCK_BUCKETS * BLOCK_BUCKETS).await
}

/// Packs the rows before the bucket `end`, the first of a block, into blocks. A database of an earlier schema has the rows of many.
async fn pack_rows(conn: &mut SqliteConnection, run: &str, task: &str, end: i64) -> Result<(), StoreError> {
    let rows = read_rows(&mut *conn, run, task).await?;
    let packed: Vec<CurveRow> = rows.into_iter().filter(|row| row.ordinal < end).collect();
    for rows in packed.chunk_by(|a, b| a.ordinal / BLOCK_BUCKETS == b.ordinal / BLOCK_BUCKETS) {
        let Some(first) = rows.first() else { continue };
        let (block, first_at) = (first.ordinal / BLOCK_BUCKETS, first.point.first_at);
        let points: Vec<&CurvePoint> = rows.iter().map(|row| &row.point).collect();
        let points = pack(to_json(&points)?.into_bytes());
        query!(
            "INSERT INTO task_curve_blocks (run, task, block, first_at, points) VALUES (?1, ?2, ?3, ?4, ?5)",
            run,
            task,
            block,
            first_at,
            points
        )
        .execute(&mut *conn)
        .await?;
    }
    query!("DELETE FROM task_curves WHERE run = ?1 AND task = ?2 AND ordinal < ?3", run, task, end)
        .execute(conn)
        .await?;
    Ok(())
}

/// Unpacks the buckets of a block.
fn read_block(stored: &[u8]) -> Result<Vec<CurvePoint>, StoreError> {
    let json = unpack(BLOCK_ITEM, stored)?;
    serde_json::from_slice(&json).map_err(|error| StoreError::corrupt(BLOCK_ITEM, error))
}

/// Reads the buckets of a task that have a row each, in order of time.
async fn read_rows(conn: &mut SqliteConnection, run: &str, task: &str) -> Result<Vec<CurveRow>, StoreError> {
    let rows = query_as!(
        StoredRow,
        "SELECT ordinal, width, first_episode, episodes, first_step, first_at, last_at, results FROM task_curves
         WHERE run = ?1 AND task = ?2 ORDER BY ordinal",
        run,
        task
    )
    .fetch_all(conn)
    .await?;
    rows.into_iter().map(StoredRow::read).collect()
}

/// A row as it is stored.
struct StoredRow {
    ordinal: i64,
    width: i64,
    first_episode: i64,
    episodes: i64,
    first_step: i64,
    first_at: Millis,
    last_at: Millis,
    results: String,
}

impl StoredRow {
    fn read(self) -> Result<CurveRow, StoreError> {
        let Self { ordinal, width, first_episode, episodes, first_step, first_at, last_at, results } = self;
        let bucket = from_json("a point of a learning curve", &results)?;
        let point = CurvePoint { first_episode, episodes, first_step, first_at, last_at, bucket };
        Ok(CurveRow { ordinal, width, point })
    }
}

/// Writes rows of a task, in place of those with the same ordinals.
async fn insert_rows(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    rows: &[CurveRow],
) -> Result<(), StoreError> {
    let results: Vec<String> = rows.iter().map(|row| to_json(&row.point.bucket)).collect::<Result<_, _>>()?;
    let mut statement = QueryBuilder::new(
        "INSERT OR REPLACE INTO task_curves (run, task, ordinal, width, first_episode, episodes, first_step, first_at,
                                             last_at, results) ",
    );
    statement.push_values(rows.iter().zip(&results), |mut values, (row, results)| {
        let CurveRow { ordinal, width, point } = row;
        values.push_bind(run).push_bind(task).push_bind(*ordinal).push_bind(*width);
        values.push_bind(point.first_episode).push_bind(point.episodes).push_bind(point.first_step);
        values.push_bind(point.first_at).push_bind(point.last_at).push_bind(results);
    });
    statement.build().execute(conn).await?;
    Ok(())
}
