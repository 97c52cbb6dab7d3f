//! The failure profile by where it came from in the inertial frame: one row a mode and sector.

use sqlx::{QueryBuilder, SqliteConnection};

use super::{ROWS, StoreError};

/// Failures of one mode from one inertial sector.
#[derive(Debug, Clone, PartialEq)]
pub struct SectorRow {
    /// The failure mode.
    pub mode: String,
    /// The sector: 0 is centred on +X, 3 on +Y.
    pub sector: i64,
    /// How many.
    pub count: i64,
    /// The count, halving every half-life, as it stood at `as_of`.
    pub weight: f64,
    /// The last one's place among the task's criticised episodes, from 1.
    pub as_of: i64,
}

/// The rows of a run's task, by mode and sector.
///
/// # Errors
/// The database's.
pub async fn of_task(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Vec<SectorRow>, StoreError> {
    Ok(sqlx::query_as!(
        SectorRow,
        "SELECT mode, sector, count, weight, as_of FROM failure_inertial
         WHERE run = ? AND task = ? ORDER BY mode, sector",
        run,
        task
    )
    .fetch_all(conn)
    .await?)
}

/// Writes rows.
///
/// # Errors
/// The database's.
pub async fn put(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    rows: &[&SectorRow],
) -> Result<(), StoreError> {
    for rows in rows.chunks(ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT OR REPLACE INTO failure_inertial (run, task, mode, sector, count, weight, as_of) ",
        );
        statement.push_values(rows, |mut values, row| {
            values.push_bind(run).push_bind(task).push_bind(&row.mode).push_bind(row.sector);
            values.push_bind(row.count).push_bind(row.weight).push_bind(row.as_of);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}
