//! Queries of retention: the amount that a run stores whole, the leases that can be compacted, and what still refers to them.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::keys::{EpisodeKey, GroupKey};
use super::leases::{Disclosure, LeaseForm, LeaseRow, LeaseStatus, Purpose, query_leases};
use super::principals::PrincipalId;
use super::{StoreError, to_json};

/// Amount of episodes that a run stores whole.
#[derive(Debug, Clone, PartialEq)]
pub struct RetainedEpisodes {
    /// Id of the run.
    pub run: String,
    /// Settings of the run as JSON.
    pub settings: String,
    /// Episodes of closed leases of groups.
    pub episodes: i64,
    /// Episodes of closed leases of columns.
    pub claimed: i64,
}

/// Reads how much each run stores whole, from the index of leases that can be compacted.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn retained(conn: &mut SqliteConnection) -> Result<Vec<RetainedEpisodes>, StoreError> {
    Ok(sqlx::query_as!(
        RetainedEpisodes,
        r#"SELECT r.id AS run, r.settings,
                  coalesce((SELECT sum(groups * group_size) FROM leases INDEXED BY leases_to_compact
                            WHERE run = r.id AND form = 'groups' AND is_compacted = 0 AND status <> 'active'
                                  AND purpose <> 'eval'), 0) AS "episodes!: i64",
                  coalesce((SELECT sum(groups * group_size) FROM leases INDEXED BY leases_to_compact
                            WHERE run = r.id AND form = 'columns' AND is_compacted = 0 AND status <> 'active'
                                  AND purpose <> 'eval'), 0) AS "claimed!: i64"
           FROM runs r WHERE r.deleted_at IS NULL"#
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the oldest closed leases of a run that neither a critique nor the trajectory feed needs. The newest lease of all is left
/// out: numbers are given after it.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn oldest_closed(
    conn: &mut SqliteConnection,
    run: &str,
    form: LeaseForm,
    limit: i64,
) -> Result<Vec<LeaseRow>, StoreError> {
    Ok(query_leases!(
        "INDEXED BY leases_to_compact
         WHERE run = ?1 AND form = ?2 AND is_compacted = 0 AND status <> 'active' AND purpose <> 'eval'
               AND NOT EXISTS (SELECT 1 FROM critique_queue q WHERE q.lease = leases.id)
               AND NOT EXISTS (SELECT 1 FROM trajectory_groups t WHERE t.lease = leases.id)
               AND id < (SELECT max(id) FROM leases)
         ORDER BY id LIMIT ?3",
        run,
        form,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads compacted leases of a run after a number, if groups of them are left.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn partly_compacted(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<LeaseRow>, StoreError> {
    Ok(query_leases!(
        "INDEXED BY leases_compacted WHERE run = ?1 AND is_compacted = 1 AND id > ?2
               AND NOT EXISTS (SELECT 1 FROM critique_queue q WHERE q.lease = leases.id)
         ORDER BY id LIMIT ?3",
        run,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the episodes of these leases that are examples of a failure.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn examples(conn: &mut SqliteConnection, leases: &[i64]) -> Result<Vec<EpisodeKey>, StoreError> {
    let leases = to_json(&leases)?;
    Ok(sqlx::query_as!(
        EpisodeKey,
        "SELECT lease, number FROM failure_examples WHERE lease IN (SELECT value FROM json_each(?))",
        leases
    )
    .fetch_all(conn)
    .await?)
}

/// Proposals of a task that some leases serve.
#[derive(Debug)]
pub struct ProposalSpan {
    /// Id of the task.
    pub task: String,
    /// Sequence number of the first proposal.
    pub first: i64,
    /// Sequence number of the last proposal.
    pub last: i64,
}

/// Reads which proposals these leases serve, by task.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn proposal_spans(
    conn: &mut SqliteConnection,
    leases: &[i64],
) -> Result<Vec<ProposalSpan>, StoreError> {
    let leases = to_json(&leases)?;
    Ok(sqlx::query_as!(
        ProposalSpan,
        r#"SELECT task AS "task!", min(proposal) AS "first!: i64", max(proposal) AS "last!: i64" FROM groups
           WHERE lease IN (SELECT value FROM json_each(?)) AND proposal IS NOT NULL GROUP BY task"#,
        leases
    )
    .fetch_all(conn)
    .await?)
}

/// Counts the stored episodes of each of these leases. Leases without any are left out.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count_episodes(
    conn: &mut SqliteConnection,
    leases: &[i64],
) -> Result<BTreeMap<i64, i64>, StoreError> {
    let leases = to_json(&leases)?;
    let rows = query!(
        r#"SELECT lease AS "lease!", count(*) AS "left!: i64" FROM episodes
           WHERE lease IN (SELECT value FROM json_each(?)) GROUP BY lease"#,
        leases
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.lease, row.left)).collect())
}

/// Reads the first group that was leased of a layout.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn first_group_of_layout(
    conn: &mut SqliteConnection,
    layout: i64,
) -> Result<Option<GroupKey>, StoreError> {
    Ok(sqlx::query_as!(
        GroupKey,
        "SELECT lease, number FROM groups WHERE layout = ? ORDER BY lease, number LIMIT 1",
        layout
    )
    .fetch_optional(conn)
    .await?)
}
