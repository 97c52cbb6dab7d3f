//! Results of groups that close: what the curriculum and the statistics of a run are based on.

use sqlx::SqliteConnection;

use super::leases::LeaseRow;
use super::{StoreError, to_json};

/// Result of a group over its finished episodes.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupResult {
    /// Number of the group in the lease.
    pub number: i64,
    /// Proposal as JSON, if the group serves one.
    pub proposal: Option<String>,
    /// Sum of the steps.
    pub steps: Option<i64>,
    /// Mean of the scores.
    pub score: Option<f64>,
    /// Mean skill of the episodes that have one.
    pub skill: Option<f64>,
    /// Lowest of the scores.
    pub lowest: Option<f64>,
    /// Highest of the scores.
    pub highest: Option<f64>,
    /// Mean regret, each within 0 to 1: (reference − score) / (reference − floor). If reference − floor is below the minimal gap
    /// of a bracket (0.05), the reference is the denominator.
    pub regret: Option<f64>,
    /// Mean positive value loss that the trainer reported.
    pub positive_value_loss: Option<f64>,
    /// Mean `MaxMC` regret that the trainer reported.
    pub max_mc: Option<f64>,
}

/// Reads the results of some groups of a lease.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn read(
    conn: &mut SqliteConnection,
    lease: &LeaseRow,
    groups: &[i64],
) -> Result<Vec<GroupResult>, StoreError> {
    let groups = to_json(&groups)?;
    Ok(sqlx::query_as!(
        GroupResult,
        r#"SELECT wanted.value + 0 AS "number!: i64", p.body AS "proposal?: String",
                  sum(e.outcome ->> '$.steps') AS "steps?: i64", avg(e.score) AS "score?: f64",
                  avg(e.skill) AS "skill?: f64", min(e.score) AS "lowest?: f64", max(e.score) AS "highest?: f64",
                  avg(min(1.0, max(0.0, (e.reference - e.score)
                      / CASE WHEN e.reference - e.floor >= 0.05 THEN e.reference - e.floor
                             ELSE max(abs(e.reference), 0.05) END))) AS "regret?: f64",
                  avg(e.metrics ->> '$.positive_value_loss') AS "positive_value_loss?: f64",
                  avg(e.metrics ->> '$.max_mc') AS "max_mc?: f64"
           FROM json_each(?1) AS wanted CROSS JOIN groups g ON g.lease = ?2 AND g.number = wanted.value
           LEFT JOIN proposals p ON p.run = ?3 AND p.seq = g.proposal
           LEFT JOIN episodes e ON e.lease = ?2 AND e.number >= wanted.value * ?4
                                   AND e.number < (wanted.value + 1) * ?4 AND e.state = 'finished'
           GROUP BY wanted.value"#,
        groups,
        lease.id,
        lease.run,
        lease.group_size
    )
    .fetch_all(conn)
    .await?)
}
