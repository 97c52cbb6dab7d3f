//! What is kept whole, what of it could be folded, and what rests on it.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::leases::LeaseRow;
use super::{StoreError, to_json};

/// How much a run keeps whole.
#[derive(Debug, Clone, PartialEq)]
pub struct Whole {
    /// The run.
    pub run: String,
    /// Its settings: JSON.
    pub settings: String,
    /// Episodes of its closed leases of groups.
    pub episodes: i64,
    /// Of those of columns.
    pub claimed: i64,
}

/// How much each run keeps whole: by the index of what could be folded.
///
/// # Errors
/// The database's.
pub async fn whole(conn: &mut SqliteConnection) -> Result<Vec<Whole>, StoreError> {
    Ok(sqlx::query_as!(
        Whole,
        r#"SELECT r.id AS run, r.settings,
                  coalesce((SELECT sum(groups * group_size) FROM leases INDEXED BY leases_to_fold
                            WHERE run = r.id AND form = 'groups' AND folded = 0 AND status <> 'active'
                                  AND purpose <> 'eval'), 0) AS "episodes!: i64",
                  coalesce((SELECT sum(groups * group_size) FROM leases INDEXED BY leases_to_fold
                            WHERE run = r.id AND form = 'columns' AND folded = 0 AND status <> 'active'
                                  AND purpose <> 'eval'), 0) AS "claimed!: i64"
           FROM runs r"#
    )
    .fetch_all(conn)
    .await?)
}

/// The oldest closed leases of a run that nothing waits for: neither the critique nor whoever pulls what was flown. The newest
/// lease of all is never one: numbers are given after it.
///
/// # Errors
/// The database's.
pub async fn oldest(
    conn: &mut SqliteConnection,
    run: &str,
    form: &str,
    limit: i64,
) -> Result<Vec<LeaseRow>, StoreError> {
    Ok(sqlx::query_as!(
        LeaseRow,
        "SELECT id, token, run, purpose, form, status, groups, group_size, policy_version, ttl_ms, created_at, expires_at,
                folded, owner
         FROM leases INDEXED BY leases_to_fold
         WHERE run = ?1 AND form = ?2 AND folded = 0 AND status <> 'active' AND purpose <> 'eval'
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

/// Folded leases of a run of which something stays, after a number.
///
/// # Errors
/// The database's.
pub async fn kept(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<LeaseRow>, StoreError> {
    Ok(sqlx::query_as!(
        LeaseRow,
        "SELECT id, token, run, purpose, form, status, groups, group_size, policy_version, ttl_ms, created_at, expires_at,
                folded, owner
         FROM leases INDEXED BY leases_folded WHERE run = ?1 AND folded = 1 AND id > ?2
               AND NOT EXISTS (SELECT 1 FROM critique_queue q WHERE q.lease = leases.id)
         ORDER BY id LIMIT ?3",
        run,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Episodes that an example of a failure names, of these leases.
///
/// # Errors
/// The database's.
pub async fn examples(conn: &mut SqliteConnection, leases: &[i64]) -> Result<Vec<(i64, i64)>, StoreError> {
    let leases = to_json(&leases)?;
    let rows = query!(
        "SELECT lease, number FROM failure_examples WHERE lease IN (SELECT value FROM json_each(?))",
        leases
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.lease, row.number)).collect())
}

/// What leases have of a task's proposals.
#[derive(Debug)]
pub struct Proposed {
    /// The task.
    pub task: String,
    /// Seq of the first.
    pub first: i64,
    /// And of the last.
    pub last: i64,
}

/// What these leases have of each task's proposals.
///
/// # Errors
/// The database's.
pub async fn proposed(conn: &mut SqliteConnection, leases: &[i64]) -> Result<Vec<Proposed>, StoreError> {
    let leases = to_json(&leases)?;
    Ok(sqlx::query_as!(
        Proposed,
        r#"SELECT task AS "task!", min(proposal) AS "first!: i64", max(proposal) AS "last!: i64" FROM groups
           WHERE lease IN (SELECT value FROM json_each(?)) AND proposal IS NOT NULL GROUP BY task"#,
        leases
    )
    .fetch_all(conn)
    .await?)
}

/// How many episodes of these leases are there.
///
/// # Errors
/// The database's.
pub async fn left(conn: &mut SqliteConnection, leases: &[i64]) -> Result<BTreeMap<i64, i64>, StoreError> {
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

/// The first group that was flown on a layout: its lease and number.
///
/// # Errors
/// The database's.
pub async fn first_of_layout(
    conn: &mut SqliteConnection,
    layout: i64,
) -> Result<Option<(i64, i64)>, StoreError> {
    let row =
        query!("SELECT lease, number FROM groups WHERE layout = ? ORDER BY lease, number LIMIT 1", layout)
            .fetch_optional(conn)
            .await?;
    Ok(row.map(|row| (row.lease, row.number)))
}
