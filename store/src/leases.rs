//! Leases and their counters. Table `leases`.

use serde::{Deserialize, Serialize};
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::groups::{self, GroupRow};
use super::{MAX_ROWS, StoreError, text_enum};
use crate::Millis;
use crate::ids::LeaseId;
use crate::principals::PrincipalId;

text_enum! {
    /// Purpose of a lease.

    pub enum Purpose: "a lease's purpose" {
        /// For episodes to learn from.
        Train = "train",
        /// To be judged by: flown without exploring, not learnt from.
        Probe = "probe",
        /// To measure: moves nothing. Its scenarios are drawn from evaluation seeds at the current levels.
        Eval = "eval",
    }
}

text_enum! {
    /// How the episodes of a lease are named and reported.
    pub enum LeaseForm: "a lease's form" {
        /// Groups of episodes that are reported one by one.
        Groups = "groups",
        /// Ranges of seeds, reported together as columns.
        Columns = "columns",
    }
}

text_enum! {
    /// When a lease discloses its scenarios.
    #[derive(Default)]
    pub enum Disclosure: "a lease's disclosure" {
        /// All with the lease.
        #[default]
        Lease = "lease",
        /// Group by group, when the trainer begins them.
        Begin = "begin",
    }
}

text_enum! {
    /// State of a lease.
    pub enum LeaseStatus: "a lease's status" {
        /// The lease accepts results until it expires.
        Active = "active",
        /// All of its groups are closed.
        Done = "done",
        /// The client returned the lease before all groups were closed.
        Released = "released",
        /// The lease expired before all groups were closed.
        Expired = "expired",
    }
}

/// Row of the `leases` table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LeaseRow {
    /// Number of the lease, from 1, in order of granting.
    pub id: i64,
    /// Token of the lease's id.
    pub id_suffix: String,
    /// Id of the run.
    #[serde(skip)]
    pub run: String,
    /// Purpose of the lease's episodes.
    pub purpose: Purpose,
    /// How its episodes are named and reported.
    pub form: LeaseForm,
    /// State of the lease.
    pub status: LeaseStatus,
    /// Number of its groups.
    pub groups: i64,
    /// Episodes in each group.
    pub group_size: i64,
    /// Version of the policy that the lease was taken for.
    pub policy_version: i64,
    /// Lifetime after granting or renewal, milliseconds.
    pub ttl_ms: i64,
    /// When the lease was granted.
    pub created_at: Millis,
    /// When the lease expires.
    pub expires_at: Millis,
    /// When the lease would have expired without a renewal.
    #[serde(skip)]
    pub first_expires_at: Millis,
    /// When the lease discloses its scenarios.
    #[serde(skip)]
    pub disclosure: Disclosure,
    /// True if the lease was compacted. Only groups that something still refers to are left of it.
    #[serde(skip)]
    pub is_compacted: bool,
    /// Principal that the lease belongs to; none if it was taken without authentication.
    #[serde(default)] // leases that were compacted earlier have no owner
    pub owner: Option<PrincipalId>,
}

impl LeaseRow {
    /// True if the lease is a lease of columns.
    #[must_use]
    pub const fn is_columns(&self) -> bool {
        matches!(self.form, LeaseForm::Columns)
    }

    /// True if the lease is in the state `Active`. It may have expired all the same: a worker ends leases after their time.
    #[must_use]
    pub const fn is_active(&self) -> bool {
        matches!(self.status, LeaseStatus::Active)
    }

    /// Id of the lease.
    #[must_use]
    pub fn lease_id(&self) -> LeaseId {
        LeaseId { number: self.id, suffix: self.id_suffix.clone() }
    }

    /// Id of the lease as text.
    #[must_use]
    pub fn name(&self) -> String {
        self.lease_id().to_string()
    }

    /// Number of episodes in the lease.
    #[must_use]
    pub const fn episodes(&self) -> i64 {
        self.groups * self.group_size
    }
}

/// Selects [`LeaseRow`]s: takes what follows `FROM leases` and the arguments of the statement.
macro_rules! query_leases {
    ($rest:literal, $($argument:expr),+ $(,)?) => {
        sqlx::query_as!(
            $crate::leases::LeaseRow,
            r#"SELECT id, id_suffix, run, purpose AS "purpose: Purpose", form AS "form: LeaseForm",
                      status AS "status: LeaseStatus", groups, group_size, policy_version, ttl_ms, created_at, expires_at,
                      first_expires_at, disclosure AS "disclosure: Disclosure", is_compacted AS "is_compacted: bool",
                      owner AS "owner: PrincipalId"
               FROM leases "# + $rest,
            $($argument),+
        )
    };
}
pub(super) use query_leases;

/// Numbers that the writer needs before it grants a lease.
#[derive(Debug, Clone, Copy)]
pub struct LeaseCounters {
    /// Number of the next lease. Numbers are never reused: there is one writer, retention never deletes the newest lease, and the
    /// deletion of a run keeps the highest number.
    pub next: i64,
    /// Active leases of the run.
    pub active: i64,
}

/// Reads the number of the next lease, and how many active leases a run has.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn counters(conn: &mut SqliteConnection, run: &str) -> Result<LeaseCounters, StoreError> {
    Ok(sqlx::query_as!(
        LeaseCounters,
        r#"SELECT 1 + max((SELECT coalesce(max(id), 0) FROM leases),
                            (SELECT coalesce(max(lease), 0) FROM highest_deleted_lease)) AS "next!: i64",
                  (SELECT count(*) FROM leases INDEXED BY leases_active WHERE run = ? AND status = 'active')
                      AS "active!: i64""#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Counts the groups that the active leases of a run took from its queue. The sum is exact up to 16, and larger beyond.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn active_groups(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT coalesce(sum(groups), 0) AS "groups!: i64"
           FROM (SELECT groups FROM leases INDEXED BY leases_active
                 WHERE run = ? AND status = 'active' AND form = 'groups' AND purpose <> 'eval' LIMIT 16)"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Stores a lease with its groups, if it has any yet.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert(
    conn: &mut SqliteConnection,
    row: &LeaseRow,
    groups: &[GroupRow],
) -> Result<(), StoreError> {
    let mut statements = QueryBuilder::new(
        "INSERT INTO leases (id, id_suffix, run, purpose, form, status, groups, group_size, policy_version, ttl_ms,
                             created_at, expires_at, first_expires_at, disclosure, owner) ",
    );
    statements.push_values([row], |mut values, row| {
        values.push_bind(row.id).push_bind(&row.id_suffix).push_bind(&row.run).push_bind(row.purpose);
        values.push_bind(row.form).push_bind(row.status).push_bind(row.groups).push_bind(row.group_size);
        values.push_bind(row.policy_version).push_bind(row.ttl_ms).push_bind(row.created_at);
        values.push_bind(row.expires_at).push_bind(row.first_expires_at).push_bind(row.disclosure);
        values.push_bind(row.owner);
    });
    let (first, others) = groups.split_at(groups.len().min(MAX_ROWS));
    if !first.is_empty() {
        // The first groups go into the same statement: each statement is a round trip between two threads.
        groups::push_insert(statements.push("; "), row.id, first);
    }
    statements.build().execute(&mut *conn).await?;
    groups::insert(conn, row.id, others).await
}

/// Reads a lease.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(conn: &mut SqliteConnection, id: i64) -> Result<Option<LeaseRow>, StoreError> {
    Ok(query_leases!("WHERE id = ?", id).fetch_optional(conn).await?)
}

/// Reads when the first lifetime of a lease ends or ended; `None` if there is no such lease.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn first_deadline(conn: &mut SqliteConnection, id: i64) -> Result<Option<Millis>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT first_expires_at FROM leases WHERE id = ?", id)
        .fetch_optional(conn)
        .await?)
}

/// Reads leases of a run after a number, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn page(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<LeaseRow>, StoreError> {
    Ok(query_leases!("WHERE run = ? AND id > ? ORDER BY id LIMIT ?", run, after, limit)
        .fetch_all(conn)
        .await?)
}

/// Reads the numbers of active leases that have expired, oldest first. The leases of a paused run do not expire.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn overdue(conn: &mut SqliteConnection, now: Millis, limit: i64) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!(
        "SELECT l.id FROM leases l JOIN runs r ON r.id = l.run
         WHERE l.status = 'active' AND l.expires_at <= ? AND r.paused_at IS NULL
         ORDER BY l.expires_at, l.id LIMIT ?",
        now,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Sets the status of a lease.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_status(conn: &mut SqliteConnection, id: i64, status: LeaseStatus) -> Result<(), StoreError> {
    query!("UPDATE leases SET status = ? WHERE id = ?", status, id).execute(conn).await?;
    Ok(())
}

/// Sets when a lease expires.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_expiry(conn: &mut SqliteConnection, id: i64, expires_at: Millis) -> Result<(), StoreError> {
    query!("UPDATE leases SET expires_at = ? WHERE id = ?", expires_at, id).execute(conn).await?;
    Ok(())
}

/// Reads the runs that are not paused and have active leases whose first lifetime is over.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn runs_with_renewed(conn: &mut SqliteConnection, now: Millis) -> Result<Vec<String>, StoreError> {
    Ok(sqlx::query_scalar!(
        "SELECT DISTINCT l.run FROM leases l JOIN runs r ON r.id = l.run
         WHERE l.status = 'active' AND l.first_expires_at <= ? AND r.paused_at IS NULL",
        now
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the active leases of a run that disclose their groups one by one.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn active_with_begin(conn: &mut SqliteConnection, run: &str) -> Result<Vec<i64>, StoreError> {
    Ok(sqlx::query_scalar!(
        "SELECT id FROM leases WHERE run = ? AND status = 'active' AND disclosure = 'begin' ORDER BY id",
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Ends an active lease that has no open group and no pending refill. Returns true if it ended.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn end_if_done(conn: &mut SqliteConnection, id: i64) -> Result<bool, StoreError> {
    let done = query!(
        "UPDATE leases SET status = 'done' WHERE id = ?1 AND status = 'active'
         AND pending_refills = 0 AND NOT EXISTS (SELECT 1 FROM groups WHERE lease = ?1 AND state = 'open')",
        id
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// Shifts the deadlines of a run's active leases by the time for which the run was paused.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn shift_deadlines(conn: &mut SqliteConnection, run: &str, by: Millis) -> Result<(), StoreError> {
    query!(
        "UPDATE leases SET expires_at = expires_at + ?1, first_expires_at = first_expires_at + ?1
         WHERE run = ?2 AND status = 'active'",
        by,
        run
    )
    .execute(conn)
    .await?;
    Ok(())
}
