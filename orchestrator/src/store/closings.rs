//! How groups ended, per run, task and level.

use sqlx::{QueryBuilder, SqliteConnection};

use super::{ROWS, StoreError};

/// How groups of more than one episode ended.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct GroupSums {
    /// The task.
    pub task: String,
    /// The level; −1 is for strategies without levels.
    pub level: i64,
    /// All of their episodes finished.
    pub complete: i64,
    /// Enough of them finished.
    pub partial: i64,
    /// Too few finished.
    pub lost: i64,
    /// Of the complete and partial ones, those whose episodes all have the same score.
    pub flat: i64,
}

/// Adds to them: one group's part each.
///
/// # Errors
/// The database's.
pub async fn add(conn: &mut SqliteConnection, run: &str, all: &[GroupSums]) -> Result<(), StoreError> {
    for rows in all.chunks(ROWS) {
        let mut statement =
            QueryBuilder::new("INSERT INTO group_sums (run, task, level, complete, partial, lost, flat) ");
        statement.push_values(rows, |mut values, sums| {
            values.push_bind(run).push_bind(&sums.task).push_bind(sums.level).push_bind(sums.complete);
            values.push_bind(sums.partial).push_bind(sums.lost).push_bind(sums.flat);
        });
        statement.push(
            " ON CONFLICT (run, task, level) DO UPDATE SET complete = complete + excluded.complete,
                  partial = partial + excluded.partial, lost = lost + excluded.lost, flat = flat + excluded.flat",
        );
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Those of a run.
///
/// # Errors
/// The database's.
pub async fn of_run(conn: &mut SqliteConnection, run: &str) -> Result<Vec<GroupSums>, StoreError> {
    Ok(sqlx::query_as!(
        GroupSums,
        "SELECT task, level, complete, partial, lost, flat FROM group_sums WHERE run = ? ORDER BY task, level",
        run
    )
    .fetch_all(conn)
    .await?)
}
