//! How groups of several episodes ended, by run, task and level. Table `group_counters`.

use sqlx::{QueryBuilder, SqliteConnection};

use super::{MAX_ROWS, StoreError};

/// Row of the `group_counters` table, without its run.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct GroupCounters {
    /// Task of the groups.
    pub task: String,
    /// Level of the groups; −1 for strategies without levels.
    pub level: i64,
    /// Groups whose episodes all finished.
    pub complete: i64,
    /// Groups in which enough episodes finished, but not all.
    pub partial: i64,
    /// Groups in which too few episodes finished.
    pub lost: i64,
    /// Complete and partial groups whose episodes all have the same score.
    pub zero_variance: i64,
}

/// Adds to the counters of a run, one entry for each group that closed.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn add(conn: &mut SqliteConnection, run: &str, all: &[GroupCounters]) -> Result<(), StoreError> {
    for rows in all.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT INTO group_counters (run, task, level, complete, partial, lost, zero_variance) ",
        );
        statement.push_values(rows, |mut values, counters| {
            values.push_bind(run).push_bind(&counters.task).push_bind(counters.level);
            values.push_bind(counters.complete).push_bind(counters.partial).push_bind(counters.lost);
            values.push_bind(counters.zero_variance);
        });
        statement.push(
            " ON CONFLICT (run, task, level) DO UPDATE SET complete = complete + excluded.complete,
                  partial = partial + excluded.partial, lost = lost + excluded.lost,
                  zero_variance = zero_variance + excluded.zero_variance",
        );
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Reads the counters of a run, by task and level.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_run(conn: &mut SqliteConnection, run: &str) -> Result<Vec<GroupCounters>, StoreError> {
    Ok(sqlx::query_as!(
        GroupCounters,
        "SELECT task, level, complete, partial, lost, zero_variance FROM group_counters WHERE run = ? ORDER BY task, level",
        run
    )
    .fetch_all(conn)
    .await?)
}
