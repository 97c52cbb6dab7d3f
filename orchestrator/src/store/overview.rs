//! How much there is of a run.

use sqlx::{SqliteConnection, query};

use super::StoreError;

/// Counts of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Episodes that finished, claimed ones included.
    pub episodes: i64,
    /// Active leases.
    pub leases: i64,
    /// Scenarios that wait to be leased.
    pub prepared: i64,
    /// Proposals that wait for their scenario.
    pub proposed: i64,
}

/// Those of a run.
///
/// # Errors
/// The database's.
pub async fn counts(conn: &mut SqliteConnection, run: &str) -> Result<Counts, StoreError> {
    let row = query!(
        r#"SELECT (SELECT coalesce(sum(episodes), 0) FROM task_sums WHERE run = ?1)
                    + (SELECT coalesce(sum(episodes - audited), 0) FROM claimed_sums WHERE run = ?1) AS "episodes!: i64",
                  (SELECT count(*) FROM leases WHERE run = ?1 AND status = 'active') AS "leases!: i64",
                  (SELECT count(*) FROM proposals INDEXED BY proposals_waiting
                   WHERE run = ?1 AND state IN ('proposed', 'prepared') AND state = 'prepared') AS "prepared!: i64",
                  (SELECT count(*) FROM proposals WHERE run = ?1 AND state = 'proposed') AS "proposed!: i64""#,
        run
    )
    .fetch_one(conn)
    .await?;
    Ok(Counts { episodes: row.episodes, leases: row.leases, prepared: row.prepared, proposed: row.proposed })
}
