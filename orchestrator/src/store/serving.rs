//! Layouts that may be served: those in stock, and those that retired by themselves.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// A layout that may be served.
#[derive(Debug, Clone)]
pub struct Servable {
    /// Its number.
    pub id: i64,
    /// The task.
    pub task: String,
    /// The level it was designed at.
    pub level: Option<i64>,
    /// `threat` or `decoy`.
    pub claim: String,
    /// Its scenario.
    pub scenario: Vec<u8>,
    /// Training groups that the run had leased when it was made.
    pub train_groups_at: i64,
    /// Groups leased.
    pub groups: i64,
}

/// The active layouts of a run, in order.
///
/// # Errors
/// The database's.
pub async fn active(conn: &mut SqliteConnection, run: &str) -> Result<Vec<Servable>, StoreError> {
    Ok(sqlx::query_as!(
        Servable,
        r#"SELECT id, task, level, claim AS "claim!", scenario AS "scenario!", train_groups_at, groups FROM layouts
           WHERE run = ? AND state = 'active' AND scenario IS NOT NULL AND claim IS NOT NULL ORDER BY id"#,
        run
    )
    .fetch_all(conn)
    .await?)
}

/// How many layouts of a run retired by themselves, by task and level.
///
/// # Errors
/// The database's.
pub async fn retired(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<Vec<(String, Option<i64>, i64)>, StoreError> {
    let rows = query!(
        r#"SELECT task AS "task!", level AS "level: i64", count(*) AS "n!: i64" FROM layouts
           WHERE run = ? AND state = 'retired' AND why IN ('mastered', 'hopeless')
           GROUP BY task, level ORDER BY task, level"#,
        run
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|r| (r.task, r.level, r.n)).collect())
}

/// The `nth` layout, from 0, of those of a run's task and level that retired by themselves.
///
/// # Errors
/// The database's.
pub async fn nth_retired(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    level: Option<i64>,
    nth: i64,
) -> Result<Option<Servable>, StoreError> {
    Ok(sqlx::query_as!(
        Servable,
        r#"SELECT id, task, level, claim AS "claim!", scenario AS "scenario!", train_groups_at, groups FROM layouts
           WHERE run = ? AND state = 'retired' AND why IN ('mastered', 'hopeless') AND task = ? AND level IS ?
           ORDER BY id LIMIT 1 OFFSET ?"#,
        run,
        task,
        level,
        nth
    )
    .fetch_optional(conn)
    .await?)
}

/// Counts a group of a layout that was leased.
///
/// # Errors
/// The database's.
pub async fn served(conn: &mut SqliteConnection, id: i64, now: Millis) -> Result<(), StoreError> {
    query!("UPDATE layouts SET groups = groups + 1, served_at = ? WHERE id = ?", now, id)
        .execute(conn)
        .await?;
    Ok(())
}
