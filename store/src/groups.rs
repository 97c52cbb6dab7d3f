//! Groups of leases. Table `groups`.

use sqlx::{QueryBuilder, Sqlite, SqliteConnection, query};

use super::keys::GroupKey;
use super::{MAX_ROWS, StoreError, text_enum, to_json};
use crate::Millis;

text_enum! {
    /// State of a group.
    pub enum GroupState: "a group's state" {
        /// Episodes are still missing.
        Open = "open",
        /// All of its episodes finished.
        Complete = "complete",
        /// Enough episodes finished for the group to count, but not all.
        Partial = "partial",
        /// Too few episodes finished.
        Lost = "lost",
    }
}

text_enum! {
    /// Role of a group: the role of its proposal, or its origin if it has no proposal.
    pub enum GroupRole: "a group's role" {
        /// Finds the level at which a new run starts.
        Placement = "placement",
        /// At the current level.
        Frontier = "frontier",
        /// A level that was passed already.
        Rehearsal = "rehearsal",
        /// Drawn by a strategy without levels, or for an evaluation lease.
        Sample = "sample",
        /// A scenario that the agent has not seen.
        Explore = "explore",
        /// A scenario that is repeated because the agent still learns from it.
        Replay = "replay",
        /// An edit of a repeated scenario.
        Edit = "edit",
        /// One parameter at its bound.
        Boundary = "boundary",
        /// At the rung that a sampler chose.
        Rung = "rung",
        /// Drawn from all rungs, so that none is forgotten.
        Coverage = "coverage",
        /// On a designed layout.
        Designed = "designed",
        /// A scenario of an evaluation suite.
        Suite = "suite",
    }
}

/// Row of the `groups` table, without its lease.
#[derive(Debug, Clone)]
pub struct GroupRow {
    /// Number of the group in the lease, from 0.
    pub number: i64,
    /// Sequence number of the proposal that the group serves; none for evaluations and designed layouts.
    pub proposal: Option<i64>,
    /// Number of the designed layout, if the group has one.
    pub layout: Option<i64>,
    /// Id of the scenario.
    pub scenario: Vec<u8>,
    /// Task of the scenario.
    pub task: String,
    /// Level of the scenario; none for strategies without levels.
    pub level: Option<i64>,
    /// Role of the group.
    pub role: GroupRole,
    /// True if the scenario is contested.
    pub is_contested: bool,
    /// State of the group.
    pub state: GroupState,
    /// Number of finished episodes.
    pub finished: i64,
    /// Number of failed episodes.
    pub failed: i64,
    /// Number of successful episodes.
    pub successes: i64,
    /// True if the purpose of the lease counts, so that strategies may use the outcome of the group.
    pub is_evidence: bool,
    /// True if the group is a slot: its result is evidence of mastery.
    pub is_slot: bool,
    /// True if the trainer has received the scenario with this lease.
    pub is_disclosed: bool,
    /// Number of finished episodes whose results count as evidence.
    pub counted: i64,
    /// Number of successes among them.
    pub counted_successes: i64,
    /// Number of episodes that a session began and left.
    pub abandoned: i64,
    /// True if the trainer should learn from the group.
    pub is_for_training: bool,
}

impl GroupRow {
    /// An open group without results. It has no proposal, layout or level, and is neither evidence nor for training.
    #[must_use]
    pub const fn open(number: i64, role: GroupRole, task: String, scenario: Vec<u8>) -> Self {
        Self {
            number,
            proposal: None,
            layout: None,
            scenario,
            task,
            level: None,
            role,
            is_contested: false,
            state: GroupState::Open,
            finished: 0,
            failed: 0,
            successes: 0,
            is_evidence: false,
            is_slot: false,
            is_disclosed: true,
            counted: 0,
            counted_successes: 0,
            abandoned: 0,
            is_for_training: false,
        }
    }

    /// True if results of the group may be evidence of mastery. A sampler learns from designed groups, too, but layouts are aimed
    /// at the agent's failures.
    #[must_use]
    pub const fn is_mastery_evidence(&self) -> bool {
        self.is_evidence && self.layout.is_none()
    }

    /// True if the episodes are for training or probing. Episodes of evaluations are not counted anywhere.
    #[must_use]
    pub const fn is_training_or_probe(&self) -> bool {
        self.proposal.is_some() || self.layout.is_some()
    }
}

/// Adds groups to a lease.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert(conn: &mut SqliteConnection, lease: i64, groups: &[GroupRow]) -> Result<(), StoreError> {
    for rows in groups.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new("");
        push_insert(&mut statement, lease, rows);
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Appends the statement that adds groups to a lease.
pub(super) fn push_insert(statement: &mut QueryBuilder<Sqlite>, lease: i64, rows: &[GroupRow]) {
    statement.push(
        "INSERT INTO groups (lease, number, proposal, layout, scenario, task, level, role, is_contested, state, failed,
                             is_evidence, is_slot, is_disclosed, is_for_training) ",
    );
    statement.push_values(rows, |mut values, row| {
        values.push_bind(lease).push_bind(row.number).push_bind(row.proposal).push_bind(row.layout);
        values.push_bind(row.scenario.clone()).push_bind(row.task.clone()).push_bind(row.level);
        values.push_bind(row.role).push_bind(row.is_contested).push_bind(row.state);
        values.push_bind(row.failed).push_bind(row.is_evidence).push_bind(row.is_slot);
        values.push_bind(row.is_disclosed).push_bind(row.is_for_training);
    });
}

/// Selects [`GroupRow`]s: takes what follows `FROM groups` and the arguments of the statement.
macro_rules! query_groups {
    ($rest:literal, $($argument:expr),+ $(,)?) => {
        sqlx::query_as!(
            GroupRow,
            r#"SELECT number, proposal, layout, scenario, task, level, role AS "role: GroupRole",
                      is_contested AS "is_contested: bool", state AS "state: GroupState", finished, failed, successes,
                      is_evidence AS "is_evidence: bool", is_slot AS "is_slot: bool",
                      is_disclosed AS "is_disclosed: bool", counted, counted_successes, abandoned,
                      is_for_training AS "is_for_training: bool"
               FROM groups "# + $rest,
            $($argument),+
        )
    };
}

/// Reads the groups of a lease in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_lease(conn: &mut SqliteConnection, lease: i64) -> Result<Vec<GroupRow>, StoreError> {
    Ok(query_groups!("WHERE lease = ? ORDER BY number", lease).fetch_all(conn).await?)
}

/// Reads a group.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(
    conn: &mut SqliteConnection,
    lease: i64,
    number: i64,
) -> Result<Option<GroupRow>, StoreError> {
    Ok(query_groups!("WHERE lease = ? AND number = ?", lease, number).fetch_optional(conn).await?)
}

/// Reads some groups of a lease, by their numbers.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get_many(
    conn: &mut SqliteConnection,
    lease: i64,
    numbers: &[i64],
) -> Result<Vec<GroupRow>, StoreError> {
    let numbers = to_json(&numbers)?;
    Ok(query_groups!("WHERE lease = ? AND number IN (SELECT value FROM json_each(?))", lease, numbers)
        .fetch_all(conn)
        .await?)
}

/// Writes the counts and states of groups. Groups that are not open closed at `now`.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
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
        let closed_at = (row.state != GroupState::Open).then_some(now);
        let GroupRow {
            number,
            state,
            finished,
            failed,
            successes,
            counted,
            counted_successes,
            abandoned,
            ..
        } = row;
        serde_json::json!([
            number,
            state,
            finished,
            failed,
            successes,
            counted,
            counted_successes,
            abandoned,
            closed_at
        ])
    };
    let rows = to_json(&rows.iter().map(values).collect::<Vec<_>>())?;
    query!(
        "WITH rows AS MATERIALIZED (
             SELECT value ->> 0 AS number, value ->> 1 AS state, value ->> 2 AS finished, value ->> 3 AS failed,
                    value ->> 4 AS successes, value ->> 5 AS counted, value ->> 6 AS counted_successes,
                    value ->> 7 AS abandoned, value ->> 8 AS closed_at
             FROM json_each(?))
         UPDATE groups SET state = rows.state, finished = rows.finished, failed = rows.failed,
                           successes = rows.successes, counted = rows.counted,
                           counted_successes = rows.counted_successes, abandoned = rows.abandoned,
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

/// Sets whether a group's scenario is contested. For leases of columns the audit finds this out.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_contested(
    conn: &mut SqliteConnection,
    group: GroupKey,
    is_contested: bool,
) -> Result<(), StoreError> {
    query!(
        "UPDATE groups SET is_contested = ? WHERE lease = ? AND number = ?",
        is_contested,
        group.lease,
        group.number
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Counts an episode of an open group as abandoned.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_abandoned(conn: &mut SqliteConnection, group: GroupKey) -> Result<(), StoreError> {
    query!(
        "UPDATE groups SET abandoned = abandoned + 1 WHERE lease = ? AND number = ? AND state = 'open'",
        group.lease,
        group.number
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the open group of a lease that serves a proposal; none if there is none.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn open_of_proposal(
    conn: &mut SqliteConnection,
    lease: i64,
    proposal: i64,
) -> Result<Option<GroupRow>, StoreError> {
    Ok(query_groups!("WHERE lease = ? AND proposal = ? AND state = 'open'", lease, proposal)
        .fetch_optional(conn)
        .await?)
}
