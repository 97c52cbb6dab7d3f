//! Design requests that wait or run. Table `design_requests`.

use sqlx::SqliteConnection;

use super::StoreError;

/// A design request by its number, with its run and task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DesignRequestRef {
    /// Number of the request.
    pub id: i64,
    /// Id of the run.
    pub run: String,
    /// Task to design for.
    pub task: String,
}

/// Reads the oldest waiting request of each run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn oldest_waiting(conn: &mut SqliteConnection) -> Result<Vec<DesignRequestRef>, StoreError> {
    // With a `min`, SQLite takes the other columns from the row that has it ("bare columns in an aggregate query").
    Ok(sqlx::query_as!(
        DesignRequestRef,
        r#"SELECT min(id) AS "id!: i64", run AS "run!", task AS "task!" FROM design_requests
           WHERE state = 'waiting' GROUP BY run ORDER BY run"#
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the running requests of all runs.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn all_running(conn: &mut SqliteConnection) -> Result<Vec<DesignRequestRef>, StoreError> {
    Ok(sqlx::query_as!(
        DesignRequestRef,
        "SELECT id, run, task FROM design_requests WHERE state = 'running' ORDER BY id"
    )
    .fetch_all(conn)
    .await?)
}

/// Counts the running requests of a run: 0 or 1.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count_running(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM design_requests WHERE run = ? AND state = 'running'"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Counts the waiting and running requests of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count_open(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM design_requests WHERE run = ? AND state IN ('waiting', 'running')"#,
        run
    )
    .fetch_one(conn)
    .await?)
}
