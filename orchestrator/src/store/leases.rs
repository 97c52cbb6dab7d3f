//! Leases and their groups.

use sqlx::{SqliteConnection, query};

use super::{StoreError, to_json};
use crate::clock::Millis;

/// A lease as stored.
#[derive(Debug, Clone, PartialEq)]
pub struct LeaseRow {
    /// Its number.
    pub id: i64,
    /// Its token.
    pub token: String,
    /// Its run.
    pub run: String,
    /// `train`, `probe` or `eval`.
    pub purpose: String,
    /// `groups` or `columns`: how its episodes are named and reported.
    pub form: String,
    /// `active`, `done`, `released` or `expired`.
    pub status: String,
    /// How many groups.
    pub groups: i64,
    /// Episodes in each.
    pub group_size: i64,
    /// The policy version it was taken for.
    pub policy_version: i64,
    /// How long it holds.
    pub ttl_ms: i64,
    /// When it was granted.
    pub created_at: Millis,
    /// Until when it holds.
    pub expires_at: Millis,
}

/// A group as stored.
#[derive(Debug, Clone)]
pub struct GroupRow {
    /// Its number in the lease.
    pub number: i64,
    /// The proposal it serves; none for eval, and where it was designed.
    pub proposal: Option<i64>,
    /// Its layout, where it was designed.
    pub layout: Option<i64>,
    /// Its scenario.
    pub scenario: Vec<u8>,
    /// The task.
    pub task: String,
    /// The level.
    pub level: Option<i64>,
    /// The proposal's role, or `designed`.
    pub role: String,
    /// Whether the scenario is contested.
    pub contested: i64,
    /// `open`, `complete`, `partial` or `lost`.
    pub state: String,
    /// Episodes that finished.
    pub finished: i64,
    /// Episodes that failed.
    pub failed: i64,
    /// Episodes that succeeded.
    pub successes: i64,
    /// Whether its outcome could move the curriculum.
    pub evidence: i64,
}

impl LeaseRow {
    /// Whether its episodes are ranges of seeds, reported as columns.
    #[must_use]
    pub fn is_columns(&self) -> bool {
        self.form == COLUMNS
    }

    /// Its id, as it is written.
    #[must_use]
    pub fn name(&self) -> String {
        crate::ids::LeaseId { number: self.id, token: self.token.clone() }.to_string()
    }

    /// How many episodes it has.
    #[must_use]
    pub const fn episodes(&self) -> i64 {
        self.groups * self.group_size
    }
}

/// The forms of a lease.
pub const GROUPS: &str = "groups";
/// See [`GROUPS`].
pub const COLUMNS: &str = "columns";

impl GroupRow {
    /// Whether its episodes are for training or probing: what is for measuring is counted nowhere.
    #[must_use]
    pub const fn counts(&self) -> bool {
        self.proposal.is_some() || self.layout.is_some()
    }
}

/// The number that the next lease gets: leases are never deleted, and one writer grants them.
///
/// # Errors
/// The database's.
pub async fn next_id(conn: &mut SqliteConnection) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(r#"SELECT coalesce(max(id), 0) + 1 AS "id!: i64" FROM leases"#)
        .fetch_one(conn)
        .await?)
}

/// Grants a lease; its number.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, row: &LeaseRow) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        "INSERT INTO leases (token, run, purpose, form, status, groups, group_size, policy_version, ttl_ms, created_at,
                             expires_at)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) RETURNING id AS \"id!\"",
        row.token,
        row.run,
        row.purpose,
        row.form,
        row.status,
        row.groups,
        row.group_size,
        row.policy_version,
        row.ttl_ms,
        row.created_at,
        row.expires_at
    )
    .fetch_one(conn)
    .await?)
}

/// Adds a group to a lease.
///
/// # Errors
/// The database's.
pub async fn insert_group(conn: &mut SqliteConnection, lease: i64, row: &GroupRow) -> Result<(), StoreError> {
    query!(
        "INSERT INTO groups (lease, number, proposal, layout, scenario, task, level, role, contested, state, failed,
                             evidence)
         VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        lease,
        row.number,
        row.proposal,
        row.layout,
        row.scenario,
        row.task,
        row.level,
        row.role,
        row.contested,
        row.state,
        row.failed,
        row.evidence
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// A lease.
///
/// # Errors
/// The database's.
pub async fn get(conn: &mut SqliteConnection, id: i64) -> Result<Option<LeaseRow>, StoreError> {
    Ok(sqlx::query_as!(
        LeaseRow,
        "SELECT id, token, run, purpose, form, status, groups, group_size, policy_version, ttl_ms, created_at, expires_at
         FROM leases WHERE id = ?",
        id
    )
    .fetch_optional(conn)
    .await?)
}

/// Leases of a run after a number, in order.
///
/// # Errors
/// The database's.
pub async fn page(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<LeaseRow>, StoreError> {
    Ok(sqlx::query_as!(
        LeaseRow,
        "SELECT id, token, run, purpose, form, status, groups, group_size, policy_version, ttl_ms, created_at, expires_at
         FROM leases WHERE run = ? AND id > ? ORDER BY id LIMIT ?",
        run,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Active leases whose time is over, the oldest first.
///
/// # Errors
/// The database's.
pub async fn overdue(conn: &mut SqliteConnection, now: Millis, limit: i64) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!(
        "SELECT id FROM leases WHERE status = 'active' AND expires_at <= ? ORDER BY expires_at, id LIMIT ?",
        now,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Sets a lease's status.
///
/// # Errors
/// The database's.
pub async fn set_status(conn: &mut SqliteConnection, id: i64, status: &str) -> Result<(), StoreError> {
    query!("UPDATE leases SET status = ? WHERE id = ?", status, id).execute(conn).await?;
    Ok(())
}

/// Sets until when a lease holds.
///
/// # Errors
/// The database's.
pub async fn set_expiry(conn: &mut SqliteConnection, id: i64, expires_at: Millis) -> Result<(), StoreError> {
    query!("UPDATE leases SET expires_at = ? WHERE id = ?", expires_at, id).execute(conn).await?;
    Ok(())
}

/// The groups of a lease in order.
///
/// # Errors
/// The database's.
pub async fn groups(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<GroupRow>, StoreError> {
    Ok(sqlx::query_as!(
        GroupRow,
        "SELECT number, proposal, layout, scenario, task, level, role, contested, state, finished, failed, successes,
                evidence
         FROM groups WHERE lease = ? ORDER BY number",
        lease
    )
    .fetch_all(conn)
    .await?)
}

/// One group.
///
/// # Errors
/// The database's.
pub async fn group(
    conn: &mut SqliteConnection,
    lease: i64,
    number: i64,
) -> Result<Option<GroupRow>, StoreError> {
    Ok(sqlx::query_as!(
        GroupRow,
        "SELECT number, proposal, layout, scenario, task, level, role, contested, state, finished, failed, successes,
                evidence
         FROM groups WHERE lease = ? AND number = ?",
        lease,
        number
    )
    .fetch_optional(conn)
    .await?)
}

/// Some groups of a lease, by their numbers.
///
/// # Errors
/// The database's.
pub async fn groups_of(
    conn: &mut SqliteConnection,
    lease: i64,
    numbers: &[i64],
) -> Result<Vec<GroupRow>, StoreError> {
    let numbers = to_json(&numbers)?;
    Ok(sqlx::query_as!(
        GroupRow,
        "SELECT number, proposal, layout, scenario, task, level, role, contested, state, finished, failed, successes,
                evidence
         FROM groups WHERE lease = ? AND number IN (SELECT value FROM json_each(?))",
        lease,
        numbers
    )
    .fetch_all(conn)
    .await?)
}

/// Writes counts and states of groups.
///
/// # Errors
/// The database's.
pub async fn update_groups(
    conn: &mut SqliteConnection,
    lease: i64,
    rows: &[GroupRow],
    closed_at: Option<Millis>,
) -> Result<(), StoreError> {
    if rows.is_empty() {
        return Ok(());
    }
    let values = |row: &GroupRow| {
        serde_json::json!([row.number, row.state, row.finished, row.failed, row.successes, row.evidence])
    };
    let rows = to_json(&rows.iter().map(values).collect::<Vec<_>>())?;
    query!(
        "UPDATE groups SET state = row.value ->> 1, finished = row.value ->> 2, failed = row.value ->> 3,
             successes = row.value ->> 4, evidence = row.value ->> 5, closed_at = ?
         FROM json_each(?) AS row WHERE groups.lease = ? AND groups.number = row.value ->> 0",
        closed_at,
        rows,
        lease
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Says whether a group's scenario is contested, where that was found out only when it was audited.
///
/// # Errors
/// The database's.
pub async fn set_contested(
    conn: &mut SqliteConnection,
    (lease, number): (i64, i64),
    contested: bool,
) -> Result<(), StoreError> {
    query!("UPDATE groups SET contested = ? WHERE lease = ? AND number = ?", contested, lease, number)
        .execute(conn)
        .await?;
    Ok(())
}

/// How many groups of a lease are still open.
///
/// # Errors
/// The database's.
pub async fn open_groups(conn: &mut SqliteConnection, lease: i64) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM groups WHERE lease = ? AND state = 'open'"#,
        lease
    )
    .fetch_one(conn)
    .await?)
}

/// How many leases of a run are active.
///
/// # Errors
/// The database's.
pub async fn active(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM leases WHERE run = ? AND status = 'active'"#,
        run
    )
    .fetch_one(conn)
    .await?)
}
