//! Rows of the views for analysis that exports need: `view_mastery` and `view_trainer_metrics`.

use serde::Serialize;
use sqlx::{SqliteConnection, query_as};

use super::StoreError;

/// Row of `view_mastery`: results and mastery of a task in a minute or an hour.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MasteryRow {
    /// Task of the results.
    pub task: String,
    /// Start of the interval, RFC 3339.
    pub at: String,
    /// Length of the interval, seconds.
    pub seconds: i64,
    /// Level of the latest mastery estimate; none for strategies without levels.
    pub level: Option<i64>,
    /// Mean of the posterior over success on contested scenarios of that level.
    pub mean: Option<f64>,
    /// 10 % quantile of the posterior.
    pub q10: Option<f64>,
    /// 90 % quantile of the posterior.
    pub q90: Option<f64>,
    /// Number of finished episodes.
    pub episodes: i64,
    /// Finished episodes that succeeded.
    pub successes: i64,
    /// Number of failed episodes.
    pub failed: i64,
    /// Episodes whose lease ended before they were reported.
    pub expired: i64,
    /// Mean score of the finished episodes.
    pub score: Option<f64>,
    /// Mean skill, over episodes that have one.
    pub skill: Option<f64>,
    /// Contested groups that are evidence.
    pub contested_groups: i64,
    /// Mean success rate of these groups.
    pub contested_success: Option<f64>,
}

/// Row of `view_trainer_metrics`: a number that the trainer logged.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrainerMetricRow {
    /// Name of the metric.
    pub name: String,
    /// Step of the trainer.
    pub step: i64,
    /// Value; none if the trainer had no finite number.
    pub value: Option<f64>,
    /// Time of the report, RFC 3339.
    pub at: String,
}

/// Reads the rows of `view_mastery` of a run, by task and time.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn mastery(conn: &mut SqliteConnection, run: &str) -> Result<Vec<MasteryRow>, StoreError> {
    Ok(query_as!(
        MasteryRow,
        r#"SELECT task AS "task!: String", at AS "at!: String", seconds AS "seconds!: i64", level AS "level: i64",
                  mean AS "mean: f64", q10 AS "q10: f64", q90 AS "q90: f64", episodes AS "episodes!: i64",
                  successes AS "successes!: i64", failed AS "failed!: i64", expired AS "expired!: i64", score AS "score: f64",
                  skill AS "skill: f64", contested_groups AS "contested_groups!: i64",
                  contested_success AS "contested_success: f64"
           FROM view_mastery WHERE run = ? ORDER BY task, at"#,
        run
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the rows of `view_trainer_metrics` of a run, by name and step.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn trainer_metrics(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<Vec<TrainerMetricRow>, StoreError> {
    Ok(query_as!(
        TrainerMetricRow,
        r#"SELECT name AS "name!: String", step AS "step!: i64", value AS "value: f64", at AS "at!: String"
           FROM view_trainer_metrics WHERE run = ? ORDER BY name, step"#,
        run
    )
    .fetch_all(conn)
    .await?)
}
