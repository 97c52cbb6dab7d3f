//! Leases and their groups.

use sqlx::{QueryBuilder, Sqlite, SqliteConnection, query};

use super::{StoreError, to_json};
use crate::clock::Millis;
use crate::ids::LeaseId;

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
    let row = LeaseRow { id: next_id(conn).await?, ..row.clone() };
    insert_with_groups(conn, &row, &[]).await?;
    Ok(row.id)
}

/// Rows of a statement.
const ROWS: usize = 32;

/// Grants a lease by its number, with its groups.
///
/// # Errors
/// The database's.
pub async fn insert_with_groups(
    conn: &mut SqliteConnection,
    row: &LeaseRow,
    groups: &[GroupRow],
) -> Result<(), StoreError> {
    let mut statements = QueryBuilder::new(
        "INSERT INTO leases (id, token, run, purpose, form, status, groups, group_size, policy_version, ttl_ms,
                             created_at, expires_at) ",
    );
    statements.push_values([row], |mut values, row| {
        values.push_bind(row.id).push_bind(&row.token).push_bind(&row.run).push_bind(&row.purpose);
        values.push_bind(&row.form).push_bind(&row.status).push_bind(row.groups).push_bind(row.group_size);
        values.push_bind(row.policy_version).push_bind(row.ttl_ms).push_bind(row.created_at);
        values.push_bind(row.expires_at);
    });
    let (first, others) = groups.split_at(groups.len().min(ROWS));
    if !first.is_empty() {
        // With the first of its groups: one turn of two threads.
        push_groups(statements.push("; "), row.id, first);
    }
    statements.build().execute(&mut *conn).await?;
    insert_groups(conn, row.id, others).await
}

/// Adds groups to a lease.
///
/// # Errors
/// The database's.
pub async fn insert_groups(
    conn: &mut SqliteConnection,
    lease: i64,
    groups: &[GroupRow],
) -> Result<(), StoreError> {
    for rows in groups.chunks(ROWS) {
        let mut statement = QueryBuilder::new("");
        push_groups(&mut statement, lease, rows);
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

fn push_groups(statement: &mut QueryBuilder<Sqlite>, lease: i64, rows: &[GroupRow]) {
    statement.push(
        "INSERT INTO groups (lease, number, proposal, layout, scenario, task, level, role, contested, state, failed,
                             evidence) ",
    );
    statement.push_values(rows, |mut values, row| {
        values.push_bind(lease).push_bind(row.number).push_bind(row.proposal).push_bind(row.layout);
        values.push_bind(row.scenario.clone()).push_bind(row.task.clone()).push_bind(row.level);
        values.push_bind(row.role.clone()).push_bind(row.contested).push_bind(row.state.clone());
        values.push_bind(row.failed).push_bind(row.evidence);
    });
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

/// Writes counts and states of groups; those that are not open were closed at this time.
///
/// # Errors
/// The database's.
pub async fn update_groups(
    conn: &mut SqliteConnection,
    lease: i64,
    rows: &[GroupRow],
    now: Millis,
) -> Result<(), StoreError> {
    if rows.is_empty() {
        return Ok(());
    }
    let values = |row: &GroupRow| {
        let closed_at = (row.state != "open").then_some(now);
        let GroupRow { number, state, finished, failed, successes, evidence, .. } = row;
        serde_json::json!([number, state, finished, failed, successes, evidence, closed_at])
    };
    let rows = to_json(&rows.iter().map(values).collect::<Vec<_>>())?;
    query!(
        "WITH rows AS MATERIALIZED (
             SELECT value ->> 0 AS number, value ->> 1 AS state, value ->> 2 AS finished, value ->> 3 AS failed,
                    value ->> 4 AS successes, value ->> 5 AS evidence, value ->> 6 AS closed_at
             FROM json_each(?))
         UPDATE groups SET state = rows.state, finished = rows.finished, failed = rows.failed,
                           successes = rows.successes, evidence = rows.evidence,
                           closed_at = rows.closed_at
         FROM rows WHERE groups.lease = ? AND groups.number = rows.number
                         AND groups.number IN (SELECT number FROM rows)",
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

/// What a group that ends is judged by.
#[derive(Debug, Clone, PartialEq)]
pub struct Closing {
    /// Its number in the lease.
    pub number: i64,
    /// Its proposal as JSON, where it serves one.
    pub body: Option<String>,
    /// The mean score of what finished.
    pub score: Option<f64>,
    /// The mean skill of what finished and has one.
    pub skill: Option<f64>,
}

/// What groups of a lease that end are judged by.
///
/// # Errors
/// The database's.
pub async fn closing(
    conn: &mut SqliteConnection,
    lease: &LeaseRow,
    groups: &[i64],
) -> Result<Vec<Closing>, StoreError> {
    let groups = to_json(&groups)?;
    Ok(sqlx::query_as!(
        Closing,
        r#"SELECT wanted.value + 0 AS "number!: i64", p.body AS "body?: String", avg(e.score) AS "score?: f64",
                  avg(e.skill) AS "skill?: f64"
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

/// Ends an active lease of which no group is open any more; whether there was something to end.
///
/// # Errors
/// The database's.
pub async fn end_if_done(conn: &mut SqliteConnection, id: i64) -> Result<bool, StoreError> {
    let done = query!(
        "UPDATE leases SET status = 'done' WHERE id = ?1 AND status = 'active'
         AND NOT EXISTS (SELECT 1 FROM groups WHERE lease = ?1 AND state = 'open')",
        id
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// How many leases of a run are active.
///
/// # Errors
/// The database's.
pub async fn active(conn: &mut SqliteConnection, run: &str) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM leases INDEXED BY leases_active WHERE run = ? AND status = 'active'"#,
        run
    )
    .fetch_one(conn)
    .await?)
}
