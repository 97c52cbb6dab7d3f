//! Leases.

use serde::{Deserialize, Serialize};
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::groups::{self, GroupRow};
use super::{ROWS, StoreError};
use crate::clock::Millis;
use crate::ids::LeaseId;

/// A lease as stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LeaseRow {
    /// Its number.
    pub id: i64,
    /// Its token.
    pub token: String,
    /// Its run.
    #[serde(skip)]
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
    /// Whether it is past what the run keeps whole: of its groups only those are left that something rests on.
    #[serde(skip)]
    pub folded: i64,
    /// The token that took it, where one was needed.
    #[serde(skip)]
    pub owner: Option<i64>,
}

impl LeaseRow {
    /// Whether its episodes are ranges of seeds, reported as columns.
    #[must_use]
    pub fn is_columns(&self) -> bool {
        self.form == COLUMNS
    }

    /// Its id.
    #[must_use]
    pub fn lease_id(&self) -> LeaseId {
        LeaseId { number: self.id, token: self.token.clone() }
    }

    /// Its id, as it is written.
    #[must_use]
    pub fn name(&self) -> String {
        self.lease_id().to_string()
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

/// What there is to know before a lease is granted.
#[derive(Debug, Clone, Copy)]
pub struct Outlook {
    /// The number that the next lease gets: leases are never deleted, and one writer grants them.
    pub next: i64,
    /// How many leases of the run are active.
    pub active: i64,
}

/// What the next lease of a run would be.
///
/// # Errors
/// The database's.
pub async fn outlook(conn: &mut SqliteConnection, run: &str) -> Result<Outlook, StoreError> {
    Ok(sqlx::query_as!(
        Outlook,
        r#"SELECT (SELECT coalesce(max(id), 0) + 1 FROM leases) AS "next!: i64",
                  (SELECT count(*) FROM leases INDEXED BY leases_active WHERE run = ? AND status = 'active')
                      AS "active!: i64""#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Grants a lease by its number, with its groups if it has any yet.
///
/// # Errors
/// The database's.
pub async fn insert(
    conn: &mut SqliteConnection,
    row: &LeaseRow,
    groups: &[GroupRow],
) -> Result<(), StoreError> {
    let mut statements = QueryBuilder::new(
        "INSERT INTO leases (id, token, run, purpose, form, status, groups, group_size, policy_version, ttl_ms,
                             created_at, expires_at, owner) ",
    );
    statements.push_values([row], |mut values, row| {
        values.push_bind(row.id).push_bind(&row.token).push_bind(&row.run).push_bind(&row.purpose);
        values.push_bind(&row.form).push_bind(&row.status).push_bind(row.groups).push_bind(row.group_size);
        values.push_bind(row.policy_version).push_bind(row.ttl_ms).push_bind(row.created_at);
        values.push_bind(row.expires_at).push_bind(row.owner);
    });
    let (first, others) = groups.split_at(groups.len().min(ROWS));
    if !first.is_empty() {
        // With the first of its groups: one turn of two threads.
        groups::push(statements.push("; "), row.id, first);
    }
    statements.build().execute(&mut *conn).await?;
    groups::insert(conn, row.id, others).await
}

/// A lease.
///
/// # Errors
/// The database's.
pub async fn get(conn: &mut SqliteConnection, id: i64) -> Result<Option<LeaseRow>, StoreError> {
    Ok(sqlx::query_as!(
        LeaseRow,
        "SELECT id, token, run, purpose, form, status, groups, group_size, policy_version, ttl_ms, created_at, expires_at,
                folded, owner
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
        "SELECT id, token, run, purpose, form, status, groups, group_size, policy_version, ttl_ms, created_at, expires_at,
                folded, owner
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

/// Ends an active lease of which no group is open any more, and that is owed none; whether there was something to end.
///
/// # Errors
/// The database's.
pub async fn end_if_done(conn: &mut SqliteConnection, id: i64) -> Result<bool, StoreError> {
    let done = query!(
        "UPDATE leases SET status = 'done' WHERE id = ?1 AND status = 'active'
         AND owed = 0 AND NOT EXISTS (SELECT 1 FROM groups WHERE lease = ?1 AND state = 'open')",
        id
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() == 1)
}
