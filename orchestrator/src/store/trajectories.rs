//! The feed: finished groups until they are acknowledged, and for a while after.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// A group to be pushed.
#[derive(Debug)]
pub struct NewGroup<'a> {
    /// Its run.
    pub run: &'a str,
    /// Its lease.
    pub lease: i64,
    /// Its number there.
    pub number: i64,
    /// The policy version that flew it.
    pub policy_version: i64,
    /// Bytes of the body as JSON.
    pub bytes: i64,
    /// The body, compressed.
    pub body: &'a [u8],
}

/// A group of the feed without its body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeadRow {
    /// Its id.
    pub id: i64,
    /// How often it was delivered.
    pub deliveries: i64,
    /// Bytes of the body as JSON.
    pub bytes: i64,
}

/// How full a feed is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Standing {
    /// Groups to be delivered now.
    pub waiting: i64,
    /// Groups delivered and not acknowledged, their time not over.
    pub delivered: i64,
    /// Groups acknowledged that are still kept.
    pub acked: i64,
    /// Bytes of groups not acknowledged, as stored.
    pub bytes: i64,
}

/// Pushes a group; its id.
///
/// # Errors
/// The database's.
pub async fn push(conn: &mut SqliteConnection, group: &NewGroup<'_>, now: Millis) -> Result<i64, StoreError> {
    let NewGroup { run, lease, number, policy_version, bytes, body } = group;
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

/// Groups of a run that may be delivered now, in order.
///
/// # Errors
/// The database's.
pub async fn visible(
    conn: &mut SqliteConnection,
    run: &str,
    now: Millis,
    limit: i64,
) -> Result<Vec<HeadRow>, StoreError> {
    Ok(sqlx::query_as!(
        HeadRow,
        "SELECT id, deliveries, bytes FROM trajectory_groups
         WHERE run = ? AND state <> 'acked' AND visible_at <= ? ORDER BY id LIMIT ?",
        run,
        now,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// When the next group that is delivered and not acknowledged will be delivered again.
///
/// # Errors
/// The database's.
pub async fn next_visible(conn: &mut SqliteConnection, run: &str) -> Result<Option<Millis>, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT min(visible_at) AS "at: i64" FROM trajectory_groups WHERE run = ? AND state <> 'acked'"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Groups of a run after an id, in order, whatever became of them.
///
/// # Errors
/// The database's.
pub async fn after(
    conn: &mut SqliteConnection,
    run: &str,
    after: i64,
    limit: i64,
) -> Result<Vec<HeadRow>, StoreError> {
    Ok(sqlx::query_as!(
        HeadRow,
        "SELECT id, deliveries, bytes FROM trajectory_groups WHERE run = ? AND id > ? ORDER BY id LIMIT ?",
        run,
        after,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Delivers a group: it is delivered again from `visible_at` on.
///
/// # Errors
/// The database's.
pub async fn deliver(conn: &mut SqliteConnection, id: i64, visible_at: Millis) -> Result<(), StoreError> {
    query!(
        "UPDATE trajectory_groups SET state = 'delivered', visible_at = ?, deliveries = deliveries + 1 WHERE id = ?",
        visible_at,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// The body of a group, compressed; none where it is kept no longer.
///
/// # Errors
/// The database's.
pub async fn body(conn: &mut SqliteConnection, id: i64) -> Result<Option<Vec<u8>>, StoreError> {
    Ok(sqlx::query_scalar!("SELECT body FROM trajectory_groups WHERE id = ?", id)
        .fetch_optional(conn)
        .await?)
}

/// Acknowledges a group of a run; whether there is such a one.
///
/// # Errors
/// The database's.
pub async fn ack(conn: &mut SqliteConnection, run: &str, id: i64) -> Result<bool, StoreError> {
    let done = query!("UPDATE trajectory_groups SET state = 'acked' WHERE id = ? AND run = ?", id, run)
        .execute(conn)
        .await?;
    Ok(done.rows_affected() == 1)
}

/// Drops acknowledged groups of a run but for the newest.
///
/// # Errors
/// The database's.
pub async fn trim(
    conn: &mut SqliteConnection,
    run: &str,
    (groups, bytes): (i64, i64),
) -> Result<(), StoreError> {
    query!(
        "DELETE FROM trajectory_groups WHERE id IN (
             SELECT id FROM (
                 SELECT id, row_number() OVER newest AS place, sum(length(body)) OVER newest AS total
                 FROM trajectory_groups WHERE run = ? AND state = 'acked' WINDOW newest AS (ORDER BY id DESC)
             ) WHERE place > ? OR total > ?
         )",
        run,
        groups,
        bytes
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// How full the feed of a run is.
///
/// # Errors
/// The database's.
pub async fn standing(conn: &mut SqliteConnection, run: &str, now: Millis) -> Result<Standing, StoreError> {
    Ok(sqlx::query_as!(
        Standing,
        r#"SELECT coalesce(sum(state <> 'acked' AND visible_at <= ?1), 0) AS "waiting!: i64",
                  coalesce(sum(state <> 'acked' AND visible_at > ?1), 0) AS "delivered!: i64",
                  coalesce(sum(state = 'acked'), 0) AS "acked!: i64",
                  coalesce(sum(CASE WHEN state <> 'acked' THEN length(body) END), 0) AS "bytes!: i64"
           FROM trajectory_groups WHERE run = ?2"#,
        now,
        run
    )
    .fetch_one(conn)
    .await?)
}
