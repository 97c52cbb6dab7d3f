//! Layouts that leases may contain: active ones, and retired ones for an occasional probe. Table `layouts`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
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
    /// Start rung that the layout was designed for, if the rungs of the task are starts.
    pub start_rung: Option<i64>,
    /// Results of the last groups, oldest first, as JSON.
    pub recent_results: String,
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
            r#"SELECT id, task, level, start_rung, recent_results, kind AS "kind!: LayoutKind", scenario AS "scenario!",
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

/// Number of mastered and hopeless layouts of a task that were designed for one place on its rungs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RetiredCount {
    /// Task of the layouts.
    pub task: String,
    /// Level of the layouts; none for strategies without levels.
    pub level: Option<i64>,
    /// Start rung of the layouts, if the rungs of the task are starts.
    pub start_rung: Option<i64>,
    /// Claim of the layouts about their scenarios.
    pub kind: LayoutKind,
    /// Number of such layouts.
    pub count: i64,
}

/// Counts the mastered and hopeless layouts of a run, by task, level, start rung and kind.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn retired(conn: &mut SqliteConnection, run: &str) -> Result<Vec<RetiredCount>, StoreError> {
    Ok(sqlx::query_as!(
        RetiredCount,
        r#"SELECT task AS "task!", level AS "level: i64", start_rung AS "start_rung: i64", kind AS "kind!: LayoutKind",
                  count(*) AS "count!: i64" FROM layouts
           WHERE run = ? AND state = 'retired' AND retirement_reason IN ('mastered', 'hopeless')
           GROUP BY task, level, start_rung, kind ORDER BY task, level, start_rung, kind"#,
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the `nth` mastered or hopeless layout of a count, from 0, in order of their numbers.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn nth_retired(
    conn: &mut SqliteConnection,
    run: &str,
    of: &RetiredCount,
    nth: i64,
) -> Result<Option<ServableLayout>, StoreError> {
    Ok(query_servable!(
        "run = ? AND state = 'retired' AND retirement_reason IN ('mastered', 'hopeless') AND task = ? AND level IS ?
         AND start_rung IS ? AND kind = ? ORDER BY id LIMIT 1 OFFSET ?",
        run,
        of.task,
        of.level,
        of.start_rung,
        of.kind,
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
