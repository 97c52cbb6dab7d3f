//! Corrections of stored results that another computation contradicts. Tables `episodes` and `layouts`.

use sqlx::{Row, SqliteConnection};

use super::StoreError;
use super::keys::EpisodeKey;

/// A stored episode with a scenario and a log.
#[derive(Debug, Clone, PartialEq)]
pub struct ReplayedRow {
    /// Id of its run.
    pub run: String,
    /// Key of the episode.
    pub key: EpisodeKey,
    /// Score as it is stored.
    pub score: Option<f64>,
}

/// Result of a replay that replaces a stored one.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrectedResult {
    /// Score of the episode.
    pub score: f64,
    /// True if the episode is a success by the run's rule.
    pub is_success: bool,
    /// Skill, if the scenario defines one.
    pub skill: Option<f64>,
    /// Outcome of the replay, as JSON.
    pub outcome: String,
}

/// Finds the episodes of a scenario whose actions have a digest.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn episodes_of(
    conn: &mut SqliteConnection,
    scenario: &[u8],
    digest: &[u8],
) -> Result<Vec<ReplayedRow>, StoreError> {
    let rows = sqlx::query(
        "SELECT l.run, e.lease, e.number, e.score FROM groups g
         JOIN leases l ON l.id = g.lease
         JOIN episodes e ON e.lease = g.lease AND e.number >= g.number * l.group_size
                        AND e.number < (g.number + 1) * l.group_size
         WHERE g.scenario = ? AND e.digest = ? AND e.score IS NOT NULL",
    )
    .bind(scenario)
    .bind(digest)
    .fetch_all(conn)
    .await?;
    let read = |row: &sqlx::sqlite::SqliteRow| -> Result<_, sqlx::Error> {
        let key = EpisodeKey { lease: row.try_get("lease")?, number: row.try_get("number")? };
        Ok(ReplayedRow { run: row.try_get("run")?, key, score: row.try_get("score")? })
    };
    rows.iter().map(|row| Ok(read(row)?)).collect()
}

/// Replaces the result of an episode.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn correct(
    conn: &mut SqliteConnection,
    key: EpisodeKey,
    result: &CorrectedResult,
) -> Result<(), StoreError> {
    let CorrectedResult { score, is_success, skill, outcome } = result;
    sqlx::query(
        "UPDATE episodes SET score = ?, success = ?, skill = ?, outcome = ? WHERE lease = ? AND number = ?",
    )
    .bind(score)
    .bind(is_success)
    .bind(skill)
    .bind(outcome)
    .bind(key.lease)
    .bind(key.number)
    .execute(conn)
    .await?;
    Ok(())
}

/// Finds the layouts of a run with a scenario that the gate admitted.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn layouts_of(
    conn: &mut SqliteConnection,
    run: &str,
    scenario: &[u8],
) -> Result<Vec<i64>, StoreError> {
    let sql = "SELECT id FROM layouts WHERE scenario = ? AND run = ? AND state != 'refused' ORDER BY id";
    Ok(sqlx::query_scalar(sql).bind(scenario).bind(run).fetch_all(conn).await?)
}
