//! Layouts that leases may contain: active ones, and retired ones for an occasional probe. Table `layouts`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use super::design_counters::LevelCount;
use super::layouts::LayoutKind;
use crate::Millis;

/// A layout that a lease may contain. Fields as in [`super::layouts::LayoutRow`].
#[derive(Debug, Clone)]
pub struct ServableLayout {
    /// Number of the layout.
    pub id: i64,
    /// Task of the layout.
    pub task: String,
    /// Level that the layout was designed for; none for strategies without levels.
    pub level: Option<i64>,
    /// Claim of the layout about its scenario.
    pub kind: LayoutKind,
    /// Id of the scenario.
    pub scenario: Vec<u8>,
    /// Training groups that the run had leased when the layout was made.
    pub training_groups_at_creation: i64,
    /// Number of leased groups.
    pub groups: i64,
}

/// Selects [`ServableLayout`]s: takes what follows `WHERE` and the arguments of the statement.
macro_rules! query_servable {
    ($condition:literal, $($argument:expr),+ $(,)?) => {
        sqlx::query_as!(
            ServableLayout,
            r#"SELECT id, task, level, kind AS "kind!: LayoutKind", scenario AS "scenario!",
                      training_groups_at_creation, groups
               FROM layouts WHERE "# + $condition,
            $($argument),+
        )
    };
}

/// Reads the active layouts of a run, in order of their numbers.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn active(conn: &mut SqliteConnection, run: &str) -> Result<Vec<ServableLayout>, StoreError> {
    Ok(query_servable!(
        "run = ? AND state = 'active' AND scenario IS NOT NULL AND kind IS NOT NULL ORDER BY id",
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Counts the mastered and hopeless layouts of a run, by task and level.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn retired(conn: &mut SqliteConnection, run: &str) -> Result<Vec<LevelCount>, StoreError> {
    Ok(sqlx::query_as!(
        LevelCount,
        r#"SELECT task AS "task!", level AS "level: i64", count(*) AS "count!: i64" FROM layouts
           WHERE run = ? AND state = 'retired' AND retirement_reason IN ('mastered', 'hopeless')
           GROUP BY task, level ORDER BY task, level"#,
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the `nth` mastered or hopeless layout of a run's task and level, from 0, in order of their numbers.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn nth_retired(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    level: Option<i64>,
    nth: i64,
) -> Result<Option<ServableLayout>, StoreError> {
    Ok(query_servable!(
        "run = ? AND state = 'retired' AND retirement_reason IN ('mastered', 'hopeless') AND task = ? AND level IS ?
         ORDER BY id LIMIT 1 OFFSET ?",
        run,
        task,
        level,
        nth
    )
    .fetch_optional(conn)
    .await?)
}

/// Counts a leased group of a layout.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_group(conn: &mut SqliteConnection, id: i64, now: Millis) -> Result<(), StoreError> {
    query!("UPDATE layouts SET groups = groups + 1, served_at = ? WHERE id = ?", now, id)
        .execute(conn)
        .await?;
    Ok(())
}
