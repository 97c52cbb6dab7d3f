//! Runs whose feeds and states the server publishes on NATS. Reads tables `runs` and
//! `run_policies`.

use sqlx::SqliteConnection;

use super::StoreError;
use crate::Millis;
use crate::runs::RunStatus;

/// A run whose feed is delivered by NATS.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NatsFeedRow {
    /// Id of the run.
    pub run: String,
    /// When the run was created.
    pub created_at: Millis,
    /// Settings of the run's policy as JSON.
    pub settings: String,
}

/// State of a run, for programs that watch it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunStateRow {
    /// Id of the run.
    pub run: String,
    /// Status of the run.
    pub status: RunStatus,
    /// True if the run is archived.
    pub is_archived: bool,
    /// Newest policy version that a trainer reported.
    pub policy_version: i64,
    /// When the run was created.
    pub created_at: Millis,
    /// Policy that the server rolls out, or `off`.
    pub policy: String,
    /// Version of this policy.
    pub version: i64,
}

/// Reads the runs whose feeds are delivered by NATS, by id.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn delivered_by_nats(conn: &mut SqliteConnection) -> Result<Vec<NatsFeedRow>, StoreError> {
    Ok(sqlx::query_as!(
        NatsFeedRow,
        "SELECT r.id AS run, r.created_at, p.settings FROM run_policies AS p JOIN runs AS r ON r.id = p.run
         WHERE r.deleted_at IS NULL AND p.settings ->> '$.delivery' = 'nats' ORDER BY p.run"
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the states of all runs, by id.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn run_states(conn: &mut SqliteConnection) -> Result<Vec<RunStateRow>, StoreError> {
    Ok(sqlx::query_as!(
        RunStateRow,
        r#"SELECT r.id AS run, r.status AS "status: RunStatus", r.archived_at IS NOT NULL AS "is_archived!: bool", r.policy_version,
                  r.created_at, coalesce(p.policy, 'off') AS "policy!: String", coalesce(p.version, 0) AS "version!: i64"
           FROM runs AS r LEFT JOIN run_policies AS p ON p.run = r.id
           WHERE r.deleted_at IS NULL ORDER BY r.id"#
    )
    .fetch_all(conn)
    .await?)
}
