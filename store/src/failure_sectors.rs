//! The failure profile of a run's task by bearing in the inertial frame: one row for each failure mode and sector. Table
//! `failure_inertial_sectors`.

use sqlx::{QueryBuilder, SqliteConnection};

use super::{MAX_ROWS, StoreError};

/// Row of the `failure_inertial_sectors` table, without its run and task.
#[derive(Debug, Clone, PartialEq)]
pub struct InertialSectorRow {
    /// Name of the failure mode.
    pub mode: String,
    /// Inertial bearing sector: 0 is centred on +X, 3 on +Y.
    pub sector: i64,
    /// Number of failures so far.
    pub count: i64,
    /// Count that halves with every half-life, at the moment `as_of`.
    pub weight: f64,
    /// Position of the last failure among the task's criticised episodes, from 1.
    pub as_of: i64,
}

/// Reads the sectors of a run's task, by mode and sector.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_task(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Vec<InertialSectorRow>, StoreError> {
    Ok(sqlx::query_as!(
        InertialSectorRow,
        "SELECT mode, sector, count, weight, as_of FROM failure_inertial_sectors
         WHERE run = ? AND task = ? ORDER BY mode, sector",
        run,
        task
    )
    .fetch_all(conn)
    .await?)
}

/// Writes sectors of a run's task, over those with the same mode and sector.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn put(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    rows: &[&InertialSectorRow],
) -> Result<(), StoreError> {
    for rows in rows.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT OR REPLACE INTO failure_inertial_sectors (run, task, mode, sector, count, weight, as_of) ",
        );
        statement.push_values(rows, |mut values, row| {
            values.push_bind(run).push_bind(task).push_bind(&row.mode).push_bind(row.sector);
            values.push_bind(row.count).push_bind(row.weight).push_bind(row.as_of);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}
