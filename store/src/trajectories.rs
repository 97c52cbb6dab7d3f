//! The trajectory feed: finished groups until a trainer acknowledges them, and for a while after. Table `trajectory_groups`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::Millis;

/// A group to be pushed to the feed.
#[derive(Debug)]
pub struct NewTrajectoryGroup<'a> {
    /// Id of the run.
    pub run: &'a str,
    /// Number of the lease.
    pub lease: i64,
    /// Number of the group in the lease.
    pub number: i64,
    /// Version of the policy that ran the group.
    pub policy_version: i64,
    /// Size of the body as JSON, bytes.
    pub bytes: i64,
    /// Body as compressed JSON.
    pub body: &'a [u8],
}

/// A group of the feed without its body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FeedGroup {
    /// Number of the group in the feed.
    pub id: i64,
    /// Number of times the group was delivered.
    pub deliveries: i64,
    /// Size of the body as JSON, bytes.
    pub bytes: i64,
}

/// Fill level of a feed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FeedCounts {
    /// Groups that can be delivered now.
    pub waiting: i64,
    /// Groups that were delivered and can still be acknowledged in time.
    pub delivered: i64,
    /// Groups that were acknowledged and are still stored.
    pub acked: i64,
    /// Stored size of the groups that are not acknowledged, bytes.
    pub bytes: i64,
}

/// Limits on the acknowledged groups of a run that stay stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AckedLimit {
    /// Number of its groups.
    pub groups: i64,
    /// Their stored size, bytes.
    pub bytes: i64,
}

/// Pushes a group to the feed of its run and returns its number.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn push(
    conn: &mut SqliteConnection,
    group: &NewTrajectoryGroup<'_>,
    now: Millis,
) -> Result<i64, StoreError> {
    let NewTrajectoryGroup { run, lease, number, policy_version, bytes, body } = group;
    Ok(sqlx::query_scalar!(
        "INSERT INTO trajectory_groups (run, lease, number, policy_version, state, visible_at, bytes, body, at)
         VALUES (?1, ?2, ?3, ?4, 'ready', ?5, ?6, ?7, ?5) RETURNING id AS \"id!\"",
        run,
        lease,
        number,
        policy_version,
        now,
        bytes,
        body
    )
    .fetch_one(conn)
    .await?)
}

/// Reads groups of a run that can be delivered now, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn deliverable(
    conn: &mut SqliteConnection,
    run: &str,
    now: Millis,
    limit: i64,
) -> Result<Vec<FeedGroup>, StoreError> {
    Ok(sqlx::query_as!(
        FeedGroup,
        "SELECT id, deliveries, bytes FROM trajectory_groups
         WHERE run = ? AND state <> 'acknowledged' AND visible_at <= ? ORDER BY id LIMIT ?",
        run,
        now,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads when the next group that is not acknowledged can be delivered.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn next_deliverable_at(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<Option<Millis>, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT min(visible_at) AS "at: i64" FROM trajectory_groups WHERE run = ? AND state <> 'acknowledged'"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Reads groups of a run after a number, in order, in any state.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn after(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<FeedGroup>, StoreError> {
    Ok(sqlx::query_as!(
        FeedGroup,
        "SELECT id, deliveries, bytes FROM trajectory_groups WHERE run = ? AND id > ? ORDER BY id LIMIT ?",
        run,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads all groups of a run that are not acknowledged, in order.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn unacknowledged(conn: &mut SqliteConnection, run: &str) -> Result<Vec<FeedGroup>, StoreError> {
    Ok(sqlx::query_as!(
        FeedGroup,
        "SELECT id, deliveries, bytes FROM trajectory_groups WHERE run = ? AND state <> 'acknowledged' ORDER BY id",
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Marks a group as delivered. It can be delivered again from `visible_at` on.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_delivered(
    conn: &mut SqliteConnection,
    id: i64,
    visible_at: Millis,
) -> Result<(), StoreError> {
    query!(
        "UPDATE trajectory_groups SET state = 'delivered', visible_at = ?, deliveries = deliveries + 1 WHERE id = ?",
        visible_at,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the compressed body of a group; none if it was deleted.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn body(conn: &mut SqliteConnection, id: i64) -> Result<Option<Vec<u8>>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT body FROM trajectory_groups WHERE id = ?", id)
        .fetch_optional(conn)
        .await?)
}

/// Acknowledges a group of a run. Returns false if there is no such group.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn ack(conn: &mut SqliteConnection, run: &str, id: i64) -> Result<bool, StoreError> {
    let done =
        query!("UPDATE trajectory_groups SET state = 'acknowledged' WHERE id = ? AND run = ?", id, run)
            .execute(conn)
            .await?;
    Ok(done.rows_affected() == 1)
}

/// Deletes the acknowledged groups of a run that exceed the limit, oldest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn trim_acked(conn: &mut SqliteConnection, run: &str, limit: AckedLimit) -> Result<(), StoreError> {
    query!(
        "DELETE FROM trajectory_groups WHERE id IN (
             SELECT id FROM (
                 SELECT id, row_number() OVER newest AS place, sum(length(body)) OVER newest AS total
                 FROM trajectory_groups WHERE run = ? AND state = 'acknowledged' WINDOW newest AS (ORDER BY id DESC)
             ) WHERE place > ? OR total > ?
         )",
        run,
        limit.groups,
        limit.bytes
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the fill level of a run's feed.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn counts(conn: &mut SqliteConnection, run: &str, now: Millis) -> Result<FeedCounts, StoreError> {
    Ok(sqlx::query_as!(
        FeedCounts,
        r#"SELECT coalesce(sum(state <> 'acknowledged' AND visible_at <= ?1), 0) AS "waiting!: i64",
                  coalesce(sum(state <> 'acknowledged' AND visible_at > ?1), 0) AS "delivered!: i64",
                  coalesce(sum(state = 'acknowledged'), 0) AS "acked!: i64",
                  coalesce(sum(CASE WHEN state <> 'acknowledged' THEN length(body) END), 0) AS "bytes!: i64"
           FROM trajectory_groups WHERE run = ?2"#,
        now,
        run
    )
    .fetch_one(conn)
    .await?)
}
