//! Counters of designed layouts: by state, by the gate's verdict, and their share of training. Tables `gate_counts`, `layouts`
//! and `runs`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use super::layouts::{LayoutState, RetirementReason};

/// Number of designs of a task with one verdict of the gate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GateCount {
    /// Task of the designs.
    pub task: String,
    /// `admitted`, or the name of the check that refused them.
    pub verdict: String,
    /// Number of such designs.
    pub count: i64,
}

/// Adds to the count of a verdict.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_verdict(
    conn: &mut SqliteConnection,
    run: &str,
    added: &GateCount,
) -> Result<(), StoreError> {
    query!(
        "INSERT INTO gate_counts (run, task, verdict, count) VALUES (?, ?, ?, ?)
         ON CONFLICT (run, task, verdict) DO UPDATE SET count = count + excluded.count",
        run,
        added.task,
        added.verdict,
        added.count
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the gate's verdicts on a run's designs, by task and verdict.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn verdicts(conn: &mut SqliteConnection, run: &str) -> Result<Vec<GateCount>, StoreError> {
    Ok(sqlx::query_as!(
        GateCount,
        "SELECT task, verdict, count FROM gate_counts WHERE run = ? ORDER BY task, verdict",
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Number of layouts of a task in one state.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LayoutCount {
    /// Task of the layouts.
    pub task: String,
    /// State of the layouts.
    pub state: LayoutState,
    /// Why they are retired.
    pub retirement_reason: Option<RetirementReason>,
    /// Number of such layouts.
    pub count: i64,
}

/// Counts the layouts of a run that the gate admitted, by task, state and reason.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn states(conn: &mut SqliteConnection, run: &str) -> Result<Vec<LayoutCount>, StoreError> {
    Ok(sqlx::query_as!(
        LayoutCount,
        r#"SELECT task AS "task!", state AS "state!: LayoutState", retirement_reason AS "retirement_reason: RetirementReason",
                  count(*) AS "count!: i64"
           FROM layouts WHERE run = ? AND state != 'refused'
           GROUP BY task, state, retirement_reason ORDER BY task, state, retirement_reason"#,
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Groups of a run that were leased for training.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct TrainingGroups {
    /// Number of all groups.
    pub all: i64,
    /// Groups of designed layouts among them.
    pub designed: i64,
}

/// Reads how many groups of a run were leased for training; zeros if there is no such run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn groups(conn: &mut SqliteConnection, run: &str) -> Result<TrainingGroups, StoreError> {
    let row = sqlx::query_as!(
        TrainingGroups,
        r#"SELECT training_groups AS "all", designed_groups AS designed FROM runs WHERE id = ?"#,
        run
    )
    .fetch_optional(conn)
    .await?;
    Ok(row.unwrap_or_default())
}

/// Adds groups that were leased for training.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add_groups(
    conn: &mut SqliteConnection,
    run: &str,
    added: TrainingGroups,
) -> Result<(), StoreError> {
    query!(
        "UPDATE runs SET training_groups = training_groups + ?, designed_groups = designed_groups + ? WHERE id = ?",
        added.all,
        added.designed,
        run
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// A task of a run with criticised episodes.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct CriticisedTask {
    /// Id of the run.
    pub run: String,
    /// Id of the task.
    pub task: String,
    /// Number of criticised episodes.
    pub criticised: i64,
}

/// Reads the tasks of active runs with designs that have at least `least` criticised episodes.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn criticised(conn: &mut SqliteConnection, least: i64) -> Result<Vec<CriticisedTask>, StoreError> {
    Ok(sqlx::query_as!(
        CriticisedTask,
        "SELECT c.run, c.task, c.criticised FROM critique_counters c JOIN runs r ON r.id = c.run
         WHERE r.status = 'active' AND c.criticised >= ? AND json_extract(r.settings, '$.design.share') > 0
               AND json_extract(r.settings, '$.design.designer') <> 'off' ORDER BY c.run, c.task",
        least
    )
    .fetch_all(conn)
    .await?)
}
