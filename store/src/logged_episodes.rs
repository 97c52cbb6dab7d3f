//! Episodes that have an action log, with the values that a replay of the log must lead to. Tables `episodes`, `leases` and `groups`.
//! Runs that are being deleted are left out.

use sqlx::{SqliteConnection, query_as};

use super::StoreError;
use super::ids::{EpisodeId, LeaseId};
use super::keys::EpisodeKey;
use crate::Millis;

/// Episode with an action log.
#[derive(Debug, Clone, PartialEq)]
pub struct LoggedEpisode {
    /// Number of the lease.
    pub lease: i64,
    /// Random part of the id of the lease.
    pub id_suffix: String,
    /// Index of the episode in the lease, from 0.
    pub number: i64,
    /// Id of the run.
    pub run: String,
    /// Id of the scenario; `None` if the group of the episode is missing.
    pub scenario: Option<Vec<u8>>,
    /// Version of the planner that computed the bracket.
    pub planner_version: Option<i64>,
    /// Score that is stored.
    pub score: Option<f64>,
    /// Skill that is stored; `None` if the scenario defines none.
    pub skill: Option<f64>,
    /// Success that is stored, by the rule of the run.
    pub success: Option<bool>,
    /// When the episode was reported.
    pub at: Millis,
}

impl LoggedEpisode {
    /// Key of the episode.
    #[must_use]
    pub const fn key(&self) -> EpisodeKey {
        EpisodeKey { lease: self.lease, number: self.number }
    }

    /// Id of the episode.
    #[must_use]
    pub fn id(&self) -> EpisodeId {
        let lease = LeaseId { number: self.lease, suffix: self.id_suffix.clone() };
        EpisodeId { lease, index: self.number }
    }
}

/// Selects [`LoggedEpisode`]s with an outcome: takes the end of the statement and its arguments.
macro_rules! query_episodes {
    ($rest:literal, $($argument:expr),+ $(,)?) => {
        query_as!(
            LoggedEpisode,
            r#"SELECT e.lease AS "lease!", l.id_suffix, e.number AS "number!", l.run, g.scenario AS "scenario?", e.planner_version,
                  e.score AS "score: f64", e.skill AS "skill: f64", e.success AS "success: bool", e.at
           FROM episodes e JOIN leases l ON l.id = e.lease JOIN runs r ON r.id = l.run AND r.deleted_at IS NULL
           LEFT JOIN groups g ON g.lease = e.lease AND g.number = e.number / l.group_size
           WHERE e.outcome IS NOT NULL "# + $rest,
            $($argument),+
        )
    };
}

/// Reads a random sample of the episodes.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn sample(conn: &mut SqliteConnection, count: i64) -> Result<Vec<LoggedEpisode>, StoreError> {
    Ok(query_episodes!("ORDER BY random() LIMIT ?", count).fetch_all(conn).await?)
}

/// Reads episodes after a key, in the order of their keys.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn after(
    conn: &mut SqliteConnection,
    key: EpisodeKey,
    limit: i64,
) -> Result<Vec<LoggedEpisode>, StoreError> {
    let rest = query_episodes!(
        "AND (e.lease, e.number) > (?, ?) ORDER BY e.lease, e.number LIMIT ?",
        key.lease,
        key.number,
        limit
    );
    Ok(rest.fetch_all(conn).await?)
}

/// Counts the episodes.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count(conn: &mut SqliteConnection) -> Result<i64, StoreError> {
    let count = sqlx::query_scalar!(
        r#"SELECT count(*) AS "count!: i64" FROM episodes e
           JOIN leases l ON l.id = e.lease JOIN runs r ON r.id = l.run AND r.deleted_at IS NULL
           WHERE e.outcome IS NOT NULL"#
    );
    Ok(count.fetch_one(conn).await?)
}
