//! The groups of leases.

use sqlx::{QueryBuilder, Sqlite, SqliteConnection, query};

use super::leases::LeaseRow;
use super::{ROWS, StoreError, to_json};
use crate::clock::Millis;

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
    /// Whether it is to be learnt from.
    pub train: i64,
}

impl GroupRow {
    /// Whether its episodes are for training or probing: what is for measuring is counted nowhere.
    #[must_use]
    pub const fn counts(&self) -> bool {
        self.proposal.is_some() || self.layout.is_some()
    }
}

/// Adds groups to a lease.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, lease: i64, groups: &[GroupRow]) -> Result<(), StoreError> {
    for rows in groups.chunks(ROWS) {
        let mut statement = QueryBuilder::new("");
        push(&mut statement, lease, rows);
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

pub(super) fn push(statement: &mut QueryBuilder<Sqlite>, lease: i64, rows: &[GroupRow]) {
    statement.push(
        "INSERT INTO groups (lease, number, proposal, layout, scenario, task, level, role, contested, state, failed,
                             evidence, train) ",
    );
    statement.push_values(rows, |mut values, row| {
        values.push_bind(lease).push_bind(row.number).push_bind(row.proposal).push_bind(row.layout);
        values.push_bind(row.scenario.clone()).push_bind(row.task.clone()).push_bind(row.level);
        values.push_bind(row.role.clone()).push_bind(row.contested).push_bind(row.state.clone());
        values.push_bind(row.failed).push_bind(row.evidence).push_bind(row.train);
    });
}

/// The groups of a lease in order.
///
/// # Errors
/// The database's.
pub async fn of_lease(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<GroupRow>, StoreError> {
    Ok(sqlx::query_as!(
        GroupRow,
        "SELECT number, proposal, layout, scenario, task, level, role, contested, state, finished, failed, successes,
                evidence, train
         FROM groups WHERE lease = ? ORDER BY number",
        lease
    )
    .fetch_all(conn)
    .await?)
}

/// The groups of a closed lease in order, with when each closed.
///
/// # Errors
/// The database's.
pub async fn closed(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<(GroupRow, Millis)>, StoreError> {
    let rows = query!(
        "SELECT number, proposal, layout, scenario, task, level, role, contested, state, finished, failed, successes,
                evidence, train, closed_at
         FROM groups WHERE lease = ? ORDER BY number",
        lease
    )
    .fetch_all(conn)
    .await?;
    let closed = rows.into_iter().map(|r| {
        let row = GroupRow {
            number: r.number,
            proposal: r.proposal,
            layout: r.layout,
            scenario: r.scenario,
            task: r.task,
            level: r.level,
            role: r.role,
            contested: r.contested,
            state: r.state,
            finished: r.finished,
            failed: r.failed,
            successes: r.successes,
            evidence: r.evidence,
            train: r.train,
        };
        (row, r.closed_at.unwrap_or(0))
    });
    Ok(closed.collect())
}

/// One group.
///
/// # Errors
/// The database's.
pub async fn get(
    conn: &mut SqliteConnection,
    lease: i64,
    number: i64,
) -> Result<Option<GroupRow>, StoreError> {
    Ok(sqlx::query_as!(
        GroupRow,
        "SELECT number, proposal, layout, scenario, task, level, role, contested, state, finished, failed, successes,
                evidence, train
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
pub async fn some(
    conn: &mut SqliteConnection,
    lease: i64,
    numbers: &[i64],
) -> Result<Vec<GroupRow>, StoreError> {
    let numbers = to_json(&numbers)?;
    Ok(sqlx::query_as!(
        GroupRow,
        "SELECT number, proposal, layout, scenario, task, level, role, contested, state, finished, failed, successes,
                evidence, train
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
pub async fn update(
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
    /// The lowest score of what finished.
    pub lowest: Option<f64>,
    /// The highest.
    pub highest: Option<f64>,
    /// The mean over what finished of how far it fell short of the reference, as a share of what was to be had above the floor; of
    /// the reference where there was hardly anything (a bracket's `MIN_GAP`).
    pub regret: Option<f64>,
    /// The mean positive value loss that the trainer reported of it.
    pub positive_value_loss: Option<f64>,
    /// The mean MaxMC regret that the trainer reported of it.
    pub max_mc: Option<f64>,
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
