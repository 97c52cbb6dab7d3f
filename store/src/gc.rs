//! Garbage collection: deletes what was compacted, and what nothing refers to any more.

use sqlx::{SqliteConnection, query};

use super::keys::{EpisodeSpan, GroupKey};
use super::{StoreError, hex_list, to_json};

/// Deletes groups, and the episodes in these spans with their logs.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn delete_groups(
    conn: &mut SqliteConnection,
    groups: &[GroupKey],
    spans: &[EpisodeSpan],
) -> Result<(), StoreError> {
    let (groups, spans) = (to_json(&groups)?, to_json(&spans)?);
    query!(
        "DELETE FROM action_logs WHERE id IN (
             SELECT a.id FROM json_each(?) AS s CROSS JOIN action_logs a
             ON a.lease = s.value ->> 0 AND a.number >= s.value ->> 1 AND a.number < s.value ->> 2)",
        spans
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "DELETE FROM episodes WHERE (lease, number) IN (
             SELECT e.lease, e.number FROM json_each(?) AS s CROSS JOIN episodes e
             ON e.lease = s.value ->> 0 AND e.number >= s.value ->> 1 AND e.number < s.value ->> 2)",
        spans
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "DELETE FROM groups WHERE (lease, number) IN (SELECT value ->> 0, value ->> 1 FROM json_each(?))",
        groups
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Deletes what leases hold beside their groups, and marks them as compacted. Deletes leases that have nothing left and that no
/// warning names.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn delete_leases(conn: &mut SqliteConnection, leases: &[i64]) -> Result<(), StoreError> {
    let leases = to_json(&leases)?;
    for statement in [
        "DELETE FROM audited_scores WHERE lease IN (SELECT value FROM json_each(?))",
        "DELETE FROM column_claims WHERE lease IN (SELECT value FROM json_each(?))",
        "DELETE FROM seed_ranges WHERE lease IN (SELECT value FROM json_each(?))",
        "DELETE FROM rollout_leases WHERE lease IN (SELECT value FROM json_each(?))",
        "UPDATE leases SET is_compacted = 1 WHERE id IN (SELECT value FROM json_each(?))",
        "DELETE FROM leases WHERE id IN (SELECT value FROM json_each(?))
             AND NOT EXISTS (SELECT 1 FROM groups g WHERE g.lease = leases.id)
             AND NOT EXISTS (SELECT 1 FROM episodes e WHERE e.lease = leases.id)
             AND NOT EXISTS (SELECT 1 FROM run_warnings w WHERE w.lease = leases.id)",
    ] {
        sqlx::query(statement).bind(&leases).execute(&mut *conn).await?;
    }
    Ok(())
}

/// Reads the lowest sequence number of a proposal that is still needed: one that waits, or one of a lease that is stored whole.
/// None if no proposal is needed.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn oldest_needed_proposal(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<Option<i64>, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT min(seq) AS "seq: i64" FROM (
               SELECT min(g.proposal) AS seq FROM leases l JOIN groups g ON g.lease = l.id
               WHERE l.run = ?1 AND l.is_compacted = 0
               UNION ALL
               SELECT min(s.proposal) FROM leases l JOIN seed_ranges s ON s.lease = l.id
               WHERE l.run = ?1 AND l.is_compacted = 0
               UNION ALL
               SELECT min(seq) FROM proposals INDEXED BY proposals_waiting
               WHERE run = ?1 AND state IN ('proposed', 'prepared'))"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Deletes up to `limit` of the oldest proposals before a sequence number. Keeps those in `held`, and those that a waiting
/// proposal repeats or edits. Returns the scenario of each deleted proposal.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn delete_proposals(
    conn: &mut SqliteConnection,
    run: &str,
    before: i64,
    held: &[i64],
    limit: i64,
) -> Result<Vec<Option<Vec<u8>>>, StoreError> {
    let held = to_json(&held)?;
    Ok(sqlx::query_scalar!(
        "DELETE FROM proposals WHERE run = ?1 AND seq IN (
             SELECT seq FROM proposals WHERE run = ?1 AND seq < ?2 AND state IN ('leased', 'dropped')
             AND seq NOT IN (SELECT value FROM json_each(?4))
             AND seq NOT IN (SELECT body ->> '$.source.of' FROM proposals INDEXED BY proposals_waiting
                             WHERE run = ?1 AND state IN ('proposed', 'prepared')
                             AND body ->> '$.source.of' IS NOT NULL)
             ORDER BY seq LIMIT ?3)
         RETURNING scenario",
        run,
        before,
        limit,
        held
    )
    .fetch_all(conn)
    .await?)
}

/// Deletes up to `limit` of the oldest curriculum events before a sequence number, if both snapshots are newer. Returns how many.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn delete_events(
    conn: &mut SqliteConnection,
    run: &str,
    before: i64,
    limit: i64,
) -> Result<u64, StoreError> {
    let done = query!(
        "DELETE FROM curriculum_events WHERE run = ?1 AND seq IN (
             SELECT seq FROM curriculum_events WHERE run = ?1 AND seq < ?2
                 AND seq < (SELECT min(seq) FROM curriculum_snapshots WHERE run = ?1 HAVING count(*) > 1)
             ORDER BY seq LIMIT ?3)",
        run,
        before,
        limit
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected())
}

/// Deletes those of these scenarios that nothing refers to, and likewise their recipes.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn delete_scenarios(conn: &mut SqliteConnection, ids: &[Vec<u8>]) -> Result<(), StoreError> {
    if ids.is_empty() {
        return Ok(());
    }
    let ids = hex_list(ids)?;
    let unreferenced = sqlx::query_scalar!(
        r#"SELECT s.id AS "id!" FROM json_each(?) AS wanted CROSS JOIN scenarios s ON s.id = unhex(wanted.value)
           WHERE NOT EXISTS (SELECT 1 FROM groups g WHERE g.scenario = s.id)
                 AND NOT EXISTS (SELECT 1 FROM audit_samples a WHERE a.scenario = s.id)
                 AND NOT EXISTS (SELECT 1 FROM proposals p WHERE p.scenario = s.id)
                 AND NOT EXISTS (SELECT 1 FROM layouts l WHERE l.scenario = s.id)"#,
        ids
    )
    .fetch_all(&mut *conn)
    .await?;
    let unreferenced = hex_list(&unreferenced)?;
    query!("DELETE FROM brackets WHERE scenario IN (SELECT unhex(value) FROM json_each(?))", unreferenced)
        .execute(&mut *conn)
        .await?;
    let recipes = sqlx::query_scalar!(
        "DELETE FROM scenarios WHERE id IN (SELECT unhex(value) FROM json_each(?)) RETURNING recipe",
        unreferenced
    )
    .fetch_all(&mut *conn)
    .await?;
    delete_recipes(conn, &recipes).await
}

/// Deletes those of these recipes that nothing refers to.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn delete_recipes(conn: &mut SqliteConnection, ids: &[Vec<u8>]) -> Result<(), StoreError> {
    let ids = hex_list(ids)?;
    query!(
        "DELETE FROM recipes WHERE id IN (SELECT unhex(value) FROM json_each(?))
             AND NOT EXISTS (SELECT 1 FROM scenarios s WHERE s.recipe = recipes.id)
             AND NOT EXISTS (SELECT 1 FROM seed_ranges r WHERE r.recipe = recipes.id)",
        ids
    )
    .execute(conn)
    .await?;
    Ok(())
}
