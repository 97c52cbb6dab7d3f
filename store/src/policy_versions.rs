//! Versions of a run's policy: their descriptions, and their results. Tables `policy_versions` and `policy_version_counters`.

use std::collections::BTreeMap;

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{MAX_ROWS, StoreError};
use crate::Millis;

/// Versions without a description whose results are kept, the newest.
const MAX_UNDESCRIBED: i64 = 10_000;

/// Row of the `policy_versions` table, without its run: the description of a version.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PolicyVersionRow {
    /// Version of the policy.
    pub version: i64,
    /// Where the trainer stores the weights.
    pub checkpoint: Option<String>,
    /// Notes that the trainer sent.
    pub notes: Option<String>,
    /// When the version was described first.
    pub at: Millis,
}

/// Results of a version on a task.
#[derive(Debug, Clone, PartialEq)]
pub struct VersionResult {
    /// Version of the policy.
    pub version: i64,
    /// Id of the task.
    pub task: String,
    /// Number of finished episodes.
    pub episodes: i64,
    /// Finished episodes that succeeded.
    pub successes: i64,
    /// Sum of the scores.
    pub score_sum: f64,
    /// When the first result arrived.
    pub first_at: Millis,
    /// When the last result arrived.
    pub last_at: Millis,
}

/// Key of version counters.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct VersionKey {
    /// Version of the policy.
    pub version: i64,
    /// Id of the task.
    pub task: String,
}

/// Counters of a version on a task.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct VersionCounters {
    /// Number of finished episodes.
    pub episodes: i64,
    /// Finished episodes that succeeded.
    pub successes: i64,
    /// Sum of the scores.
    pub score_sum: f64,
}

/// Writes the description of a version, over an earlier one.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn put(conn: &mut SqliteConnection, run: &str, row: &PolicyVersionRow) -> Result<(), StoreError> {
    query!(
        "INSERT INTO policy_versions (run, version, checkpoint, notes, at) VALUES (?, ?, ?, ?, ?)
         ON CONFLICT (run, version) DO UPDATE SET checkpoint = excluded.checkpoint, notes = excluded.notes",
        run,
        row.version,
        row.checkpoint,
        row.notes,
        row.at
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the description of a version.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(
    conn: &mut SqliteConnection,
    run: &str,
    version: i64,
) -> Result<Option<PolicyVersionRow>, StoreError> {
    Ok(sqlx::query_as!(
        PolicyVersionRow,
        "SELECT version, checkpoint, notes, at FROM policy_versions WHERE run = ? AND version = ?",
        run,
        version
    )
    .fetch_optional(conn)
    .await?)
}

/// Reads the versions of a run below `before` that have a description or results, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn known(
    conn: &mut SqliteConnection,
    run: &str,
    before: i64,
    limit: i64,
) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT version AS "version!: i64" FROM policy_versions WHERE run = ?1 AND version < ?2
           UNION SELECT version FROM policy_version_counters WHERE run = ?1 AND version < ?2
           ORDER BY 1 DESC LIMIT ?3"#,
        run,
        before,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the descriptions of the versions `from` to `to`, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn descriptions(
    conn: &mut SqliteConnection,
    run: &str,
    from: i64,
    to: i64,
) -> Result<Vec<PolicyVersionRow>, StoreError> {
    Ok(sqlx::query_as!(
        PolicyVersionRow,
        "SELECT version, checkpoint, notes, at FROM policy_versions
         WHERE run = ? AND version BETWEEN ? AND ? ORDER BY version DESC",
        run,
        from,
        to
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the results of the versions `from` to `to`, newest first, by task.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn results(
    conn: &mut SqliteConnection,
    run: &str,
    from: i64,
    to: i64,
) -> Result<Vec<VersionResult>, StoreError> {
    Ok(sqlx::query_as!(
        VersionResult,
        "SELECT version, task, episodes, successes, score_sum, first_at, last_at FROM policy_version_counters
         WHERE run = ? AND version BETWEEN ? AND ? ORDER BY version DESC, task",
        run,
        from,
        to
    )
    .fetch_all(conn)
    .await?)
}

/// Adds to the counters of a run's versions, and deletes the oldest ones without a description.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn add(
    conn: &mut SqliteConnection,
    run: &str,
    added: &BTreeMap<VersionKey, VersionCounters>,
    now: Millis,
) -> Result<(), StoreError> {
    let all: Vec<_> = added.iter().collect();
    for rows in all.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT INTO policy_version_counters (run, version, task, episodes, successes, score_sum, first_at, last_at) ",
        );
        statement.push_values(rows, |mut values, (key, counters)| {
            values.push_bind(run).push_bind(key.version).push_bind(&key.task).push_bind(counters.episodes);
            values.push_bind(counters.successes).push_bind(counters.score_sum).push_bind(now).push_bind(now);
        });
        statement.push(
            " ON CONFLICT (run, version, task) DO UPDATE SET episodes = episodes + excluded.episodes,
                  successes = successes + excluded.successes, score_sum = score_sum + excluded.score_sum,
                  last_at = excluded.last_at",
        );
        statement.build().execute(&mut *conn).await?;
    }
    let newest = added.keys().map(|key| key.version).max().unwrap_or(0);
    let before = newest - MAX_UNDESCRIBED;
    if before <= 0 {
        return Ok(());
    }
    query!(
        "DELETE FROM policy_version_counters WHERE run = ?1 AND version < ?2
         AND version NOT IN (SELECT version FROM policy_versions WHERE run = ?1)",
        run,
        before
    )
    .execute(conn)
    .await?;
    Ok(())
}
