//! Versions of a run's policy: what was told of them, and how they fared.

use std::collections::BTreeMap;

use sqlx::{QueryBuilder, SqliteConnection, query};

use super::{ROWS, StoreError};
use crate::clock::Millis;

/// Versions of a run that are remembered without having been told of, the newest.
const UNTOLD: i64 = 10_000;

/// What a version is told to be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VersionRow {
    /// The version.
    pub version: i64,
    /// Where its weights are.
    pub checkpoint: Option<String>,
    /// What else was told.
    pub notes: Option<String>,
    /// When.
    pub at: Millis,
}

/// How a version fared on a task.
#[derive(Debug, Clone, PartialEq)]
pub struct VersionSums {
    /// The version.
    pub version: i64,
    /// The task.
    pub task: String,
    /// Episodes that finished.
    pub episodes: i64,
    /// Of these, successes.
    pub successes: i64,
    /// Sum of scores.
    pub score: f64,
    /// When the first came in.
    pub first_at: Millis,
    /// When the last did.
    pub last_at: Millis,
}

/// Episodes, successes and the sum of their scores, by version and task.
pub type Fared = BTreeMap<(i64, String), (i64, i64, f64)>;

/// Writes what a version is told to be; what was told before is replaced.
///
/// # Errors
/// The database's.
pub async fn put(conn: &mut SqliteConnection, run: &str, row: &VersionRow) -> Result<(), StoreError> {
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

/// What a version was told to be.
///
/// # Errors
/// The database's.
pub async fn get(
    conn: &mut SqliteConnection,
    run: &str,
    version: i64,
) -> Result<Option<VersionRow>, StoreError> {
    Ok(sqlx::query_as!(
        VersionRow,
        "SELECT version, checkpoint, notes, at FROM policy_versions WHERE run = ? AND version = ?",
        run,
        version
    )
    .fetch_optional(conn)
    .await?)
}

/// The versions of a run that are known by word or deed, below one, the newest first.
///
/// # Errors
/// The database's.
pub async fn below(
    conn: &mut SqliteConnection,
    run: &str,
    before: i64,
    limit: i64,
) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT version AS "version!: i64" FROM policy_versions WHERE run = ?1 AND version < ?2
           UNION SELECT version FROM version_sums WHERE run = ?1 AND version < ?2
           ORDER BY 1 DESC LIMIT ?3"#,
        run,
        before,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// What versions in a range were told to be, the newest first.
///
/// # Errors
/// The database's.
pub async fn told(
    conn: &mut SqliteConnection,
    run: &str,
    (from, to): (i64, i64),
) -> Result<Vec<VersionRow>, StoreError> {
    Ok(sqlx::query_as!(
        VersionRow,
        "SELECT version, checkpoint, notes, at FROM policy_versions
         WHERE run = ? AND version BETWEEN ? AND ? ORDER BY version DESC",
        run,
        from,
        to
    )
    .fetch_all(conn)
    .await?)
}

/// How versions in a range fared, the newest first, task by task.
///
/// # Errors
/// The database's.
pub async fn sums(
    conn: &mut SqliteConnection,
    run: &str,
    (from, to): (i64, i64),
) -> Result<Vec<VersionSums>, StoreError> {
    Ok(sqlx::query_as!(
        VersionSums,
        "SELECT version, task, episodes, successes, score, first_at, last_at FROM version_sums
         WHERE run = ? AND version BETWEEN ? AND ? ORDER BY version DESC, task",
        run,
        from,
        to
    )
    .fetch_all(conn)
    .await?)
}

/// Adds to how versions fared, and forgets the oldest of very many.
///
/// # Errors
/// The database's.
pub async fn add(
    conn: &mut SqliteConnection,
    run: &str,
    fared: &Fared,
    now: Millis,
) -> Result<(), StoreError> {
    let all: Vec<_> = fared.iter().collect();
    for rows in all.chunks(ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT INTO version_sums (run, version, task, episodes, successes, score, first_at, last_at) ",
        );
        statement.push_values(rows, |mut values, ((version, task), (episodes, successes, score))| {
            values.push_bind(run).push_bind(*version).push_bind(task).push_bind(*episodes);
            values.push_bind(*successes).push_bind(*score).push_bind(now).push_bind(now);
        });
        statement.push(
            " ON CONFLICT (run, version, task) DO UPDATE SET episodes = episodes + excluded.episodes,
                  successes = successes + excluded.successes, score = score + excluded.score, last_at = excluded.last_at",
        );
        statement.build().execute(&mut *conn).await?;
    }
    let newest = fared.keys().map(|(version, _)| *version).max().unwrap_or(0);
    let before = newest - UNTOLD;
    if before <= 0 {
        return Ok(());
    }
    query!(
        "DELETE FROM version_sums WHERE run = ?1 AND version < ?2
         AND version NOT IN (SELECT version FROM policy_versions WHERE run = ?1)",
        run,
        before
    )
    .execute(conn)
    .await?;
    Ok(())
}
