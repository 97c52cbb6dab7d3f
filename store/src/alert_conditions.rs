//! What alerts depend on: the latest results of runs, missing episodes, moves down, and evaluations of policy versions.

use sqlx::{SqliteConnection, query_as};

use super::{Millis, StoreError};

/// Active run with results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ActiveRun {
    /// Id of the run.
    pub run: String,
    /// When it had its latest results.
    pub last_results_at: Millis,
}

/// Reads the active runs whose latest results came at this time or later.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn active_runs(conn: &mut SqliteConnection, since: Millis) -> Result<Vec<ActiveRun>, StoreError> {
    Ok(query_as!(
        ActiveRun,
        "SELECT t.run, t.last_results_at FROM run_totals t INDEXED BY run_totals_recent CROSS JOIN runs r ON r.id = t.run
         WHERE t.last_results_at >= ? AND r.status = 'active' AND r.archived_at IS NULL AND r.deleted_at IS NULL
         ORDER BY t.last_results_at",
        since
    )
    .fetch_all(conn)
    .await?)
}

/// Episodes of a task that ended within some minutes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EndedEpisodes {
    /// Id of the task.
    pub task: String,
    /// Number of reported episodes.
    pub finished: i64,
    /// Number of episodes that failed, or whose lease ended before they were reported.
    pub missing: i64,
}

/// Counts the episodes of a run's tasks in the minutes that began at `since` or later.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn ended_episodes(
    conn: &mut SqliteConnection,
    run: &str,
    since: Millis,
) -> Result<Vec<EndedEpisodes>, StoreError> {
    let tasks = super::history::tasks(&mut *conn, run).await?;
    Ok(query_as!(
        EndedEpisodes,
        r#"SELECT h.task AS "task!: String", sum(h.episodes) AS "finished!: i64", sum(h.failed + h.expired) AS "missing!: i64"
           FROM json_each(?2) t CROSS JOIN task_history h ON h.run = ?1 AND h.task = t.value AND h.width = 60000 AND h.start >= ?3
           GROUP BY h.task"#,
        run,
        tasks,
        since
    )
    .fetch_all(conn)
    .await?)
}

/// Move of a task down a level.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LevelDrop {
    /// Id of the run.
    pub run: String,
    /// Id of the task.
    pub task: String,
    /// Number of the outcome after which it moved.
    pub seq: i64,
    /// Level before the move.
    pub from_level: Option<i64>,
    /// Level after the move.
    pub to_level: i64,
}

/// Reads the newest moves down at this time or later, oldest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn level_drops(
    conn: &mut SqliteConnection,
    since: Millis,
    limit: i64,
) -> Result<Vec<LevelDrop>, StoreError> {
    let mut drops = query_as!(
        LevelDrop,
        r#"SELECT run AS "run!: String", task AS "task!: String", seq AS "seq!: i64", from_level, to_level AS "to_level!: i64"
           FROM level_moves INDEXED BY level_moves_down WHERE kind = 'down' AND at >= ? ORDER BY at DESC LIMIT ?"#,
        since,
        limit
    )
    .fetch_all(conn)
    .await?;
    drops.reverse();
    Ok(drops)
}

/// Two evaluations of a run on one suite: of a policy version, and of the version before.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SuccessiveEvaluations {
    /// Id of the run.
    pub run: String,
    /// Number of the later one.
    pub newer: i64,
    /// Number of the one before.
    pub older: i64,
}

/// Reads the evaluations of policy versions that were complete at this time or later, each with the last complete evaluation of
/// an earlier version of the same run, suite and tasks.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn successive_evaluations(
    conn: &mut SqliteConnection,
    since: Millis,
    limit: i64,
) -> Result<Vec<SuccessiveEvaluations>, StoreError> {
    Ok(query_as!(
        SuccessiveEvaluations,
        r#"SELECT run AS "run!: String", newer AS "newer!: i64", older AS "older!: i64" FROM (
               SELECT e.run, e.id AS newer, (
                   SELECT max(b.id) FROM evaluations b INDEXED BY evaluations_of_run
                   WHERE b.run = e.run AND b.id < e.id AND b.state = 'complete' AND b.suite_hash = e.suite_hash AND b.tasks IS e.tasks
                         AND b.policy_version < e.policy_version) AS older
               FROM evaluations e INDEXED BY evaluations_completed
               WHERE e.run IS NOT NULL AND e.state = 'complete' AND e.completed_at >= ?
               ORDER BY e.completed_at DESC LIMIT ?)
           WHERE older IS NOT NULL ORDER BY newer"#,
        since,
        limit
    )
    .fetch_all(conn)
    .await?)
}
