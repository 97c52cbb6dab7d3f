//! Deletes what was folded, and what then nobody refers to any more.

use sqlx::{SqliteConnection, query};

use super::{StoreError, hex_list, to_json};

/// Deletes groups, by lease and number, with their episodes and logs. `spans` are the same as (lease, first index, last index
/// + 1).
///
/// # Errors
/// The database's.
pub async fn delete_groups(
    conn: &mut SqliteConnection,
    groups: &[(i64, i64)],
    spans: &[(i64, i64, i64)],
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

/// Deletes what leases hold beside their groups, and says of them that they are folded; those of which nothing is left, and
/// that no mark names, go.
///
/// # Errors
/// The database's.
pub async fn delete_leases(conn: &mut SqliteConnection, leases: &[i64]) -> Result<(), StoreError> {
    let leases = to_json(&leases)?;
    for statement in [
        "DELETE FROM audited_scores WHERE lease IN (SELECT value FROM json_each(?))",
        "DELETE FROM column_claims WHERE lease IN (SELECT value FROM json_each(?))",
        "DELETE FROM seed_ranges WHERE lease IN (SELECT value FROM json_each(?))",
        "DELETE FROM rollout_leases WHERE lease IN (SELECT value FROM json_each(?))",
        "UPDATE leases SET folded = 1 WHERE id IN (SELECT value FROM json_each(?))",
        "DELETE FROM leases WHERE id IN (SELECT value FROM json_each(?))
             AND NOT EXISTS (SELECT 1 FROM groups g WHERE g.lease = leases.id)
             AND NOT EXISTS (SELECT 1 FROM episodes e WHERE e.lease = leases.id)
             AND NOT EXISTS (SELECT 1 FROM run_marks m WHERE m.lease = leases.id)",
    ] {
        sqlx::query(statement).bind(&leases).execute(&mut *conn).await?;
    }
    Ok(())
}

/// The seq before which no proposal of a run is wanted any more: none waits, and no lease that is kept whole has one.
///
/// # Errors
/// The database's.
pub async fn unwanted_before(conn: &mut SqliteConnection, run: &str) -> Result<Option<i64>, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT min(seq) AS "seq: i64" FROM (
               SELECT min(g.proposal) AS seq FROM leases l JOIN groups g ON g.lease = l.id
               WHERE l.run = ?1 AND l.folded = 0
               UNION ALL
               SELECT min(s.proposal) FROM leases l JOIN seed_ranges s ON s.lease = l.id
               WHERE l.run = ?1 AND l.folded = 0
               UNION ALL
               SELECT min(seq) FROM proposals INDEXED BY proposals_waiting
               WHERE run = ?1 AND state IN ('proposed', 'prepared'))"#,
        run
    )
    .fetch_one(conn)
    .await?)
}

/// Deletes the oldest proposals before a seq, but for those that are held and those that one that waits goes on from; the
/// scenarios they had, and how many went.
///
/// # Errors
/// The database's.
pub async fn delete_proposals(
    conn: &mut SqliteConnection,
    run: &str,
    before: i64,
    (held, limit): (&[i64], i64),
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

/// Deletes the oldest events of a curriculum before a seq, as far as both snapshots that are kept are newer; how many.
///
/// # Errors
/// The database's.
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

/// Deletes those of these scenarios that nobody refers to any more, and their recipes likewise.
///
/// # Errors
/// The database's.
pub async fn delete_scenarios(conn: &mut SqliteConnection, ids: &[Vec<u8>]) -> Result<(), StoreError> {
    if ids.is_empty() {
        return Ok(());
    }
    let ids = hex_list(ids)?;
    let unwanted = sqlx::query_scalar!(
        r#"SELECT s.id AS "id!" FROM json_each(?) AS wanted CROSS JOIN scenarios s ON s.id = unhex(wanted.value)
           WHERE NOT EXISTS (SELECT 1 FROM groups g WHERE g.scenario = s.id)
                 AND NOT EXISTS (SELECT 1 FROM proposals p WHERE p.scenario = s.id)
                 AND NOT EXISTS (SELECT 1 FROM layouts l WHERE l.scenario = s.id)"#,
        ids
    )
    .fetch_all(&mut *conn)
    .await?;
    let unwanted = hex_list(&unwanted)?;
    query!("DELETE FROM brackets WHERE scenario IN (SELECT unhex(value) FROM json_each(?))", unwanted)
        .execute(&mut *conn)
        .await?;
    let recipes = sqlx::query_scalar!(
        "DELETE FROM scenarios WHERE id IN (SELECT unhex(value) FROM json_each(?)) RETURNING recipe",
        unwanted
    )
    .fetch_all(&mut *conn)
    .await?;
    let recipes = hex_list(&recipes)?;
    query!(
        "DELETE FROM recipes WHERE id IN (SELECT unhex(value) FROM json_each(?))
             AND NOT EXISTS (SELECT 1 FROM scenarios s WHERE s.recipe = recipes.id)
             AND NOT EXISTS (SELECT 1 FROM seed_ranges r WHERE r.recipe = recipes.id)",
        recipes
    )
    .execute(conn)
    .await?;
    Ok(())
}
