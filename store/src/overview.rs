//! Amounts of data that a run's card shows.

use sqlx::SqliteConnection;

use super::StoreError;

/// Counts of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RunCounts {
    /// Episodes that finished, including those of accepted claims.
    pub episodes: i64,
    /// Number of active leases.
    pub leases: i64,
    /// Prepared scenarios that wait to be leased.
    pub prepared: i64,
    /// Proposals that wait for their scenario.
    pub proposed: i64,
}

/// Reads the counts of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn counts(conn: &mut SqliteConnection, run: &str) -> Result<RunCounts, StoreError> {
    Ok(sqlx::query_as!(
        RunCounts,
        r#"SELECT (SELECT coalesce(sum(episodes), 0) FROM task_counters WHERE run = ?1)
                    + (SELECT coalesce(sum(episodes - audited), 0) FROM claim_counters WHERE run = ?1) AS "episodes!: i64",
                  (SELECT count(*) FROM leases WHERE run = ?1 AND status = 'active') AS "leases!: i64",
                  (SELECT count(*) FROM proposals INDEXED BY proposals_waiting
                   WHERE run = ?1 AND state IN ('proposed', 'prepared') AND state = 'prepared') AS "prepared!: i64",
                  (SELECT count(*) FROM proposals WHERE run = ?1 AND state = 'proposed') AS "proposed!: i64""#,
        run
    )
    .fetch_one(conn)
    .await?)
}
