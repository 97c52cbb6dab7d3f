//! Numbers that trainers log about their training. Tables `trainer_metrics` and `trainer_metric_names`.

use std::fmt;
use std::str::FromStr;

use env_core::text::{MAX_QUOTED_CHARS, shorten};
use sqlx::{QueryBuilder, SqliteConnection, query, query_scalar};

use super::{MAX_ROWS, StoreError, to_json};
use crate::Millis;

/// Number of stored points of a metric above which every second one is deleted.
pub const MAX_POINTS: i64 = 4_000;

/// Name of a metric: 1 to 128 of `a-z A-Z 0-9 _ . : / -`, beginning with a letter or a digit.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct MetricName(String);

/// A text that is not the name of a metric.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "a name must have 1 to 128 of a-z, A-Z, 0-9, _, ., :, / and -, and begin with a letter or a digit, got {0:?}"
)]
pub struct InvalidMetricName(String);

impl MetricName {
    /// Maximum length of a name.
    const MAX_CHARS: usize = 128;

    /// The name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl FromStr for MetricName {
    type Err = InvalidMetricName;

    fn from_str(text: &str) -> Result<Self, InvalidMetricName> {
        let is_valid = |c: char| c.is_ascii_alphanumeric() || "_.:/-".contains(c);
        let begins = text.starts_with(|c: char| c.is_ascii_alphanumeric());
        if text.len() <= Self::MAX_CHARS && begins && text.chars().all(is_valid) {
            Ok(Self(text.to_owned()))
        } else {
            Err(InvalidMetricName(shorten(text, MAX_QUOTED_CHARS)))
        }
    }
}

impl fmt::Display for MetricName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Metrics of a trainer at one step.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricsAtStep {
    /// Step of the trainer.
    pub step: i64,
    /// Values by name, each name once; `None` for a number that is not finite.
    pub values: Vec<(MetricName, Option<f64>)>,
}

/// Point of a metric: one report, or the mean of several successive ones.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricPoint {
    /// Name of the metric.
    pub name: String,
    /// Last step of the point.
    pub step: i64,
    /// Time of the last report of the point.
    pub at: Millis,
    /// Mean of the finite values.
    pub value: Option<f64>,
    /// Value of the last step.
    pub last_value: Option<f64>,
}

/// Counts the metrics that a run would have with these as well.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count_with(
    conn: &mut SqliteConnection,
    run: &str,
    metrics: &MetricsAtStep,
) -> Result<i64, StoreError> {
    let names: Vec<&str> = metrics.values.iter().map(|(name, _)| name.as_str()).collect();
    let names = to_json(&names)?;
    Ok(query_scalar!(
        r#"SELECT count(*) AS "count!: i64" FROM (
               SELECT name FROM trainer_metric_names WHERE run = ?1 UNION SELECT value FROM json_each(?2))"#,
        run,
        names
    )
    .fetch_one(conn)
    .await?)
}

/// Stores the metrics of a step, over earlier ones of the same step, and thins those with more than [`MAX_POINTS`] points: every
/// second point is deleted, but never the newest.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn put(
    conn: &mut SqliteConnection,
    run: &str,
    metrics: &MetricsAtStep,
    now: Millis,
) -> Result<(), StoreError> {
    for rows in metrics.values.chunks(MAX_ROWS) {
        let mut points = QueryBuilder::new("INSERT INTO trainer_metrics (run, name, step, at, value) ");
        points.push_values(rows, |mut row, (name, value)| {
            row.push_bind(run)
                .push_bind(name.as_str())
                .push_bind(metrics.step)
                .push_bind(now)
                .push_bind(*value);
        });
        points.push(" ON CONFLICT (run, name, step) DO UPDATE SET at = excluded.at, value = excluded.value");
        points.build().execute(&mut *conn).await?;
        let mut names = QueryBuilder::new("INSERT INTO trainer_metric_names (run, name, points) ");
        names.push_values(rows, |mut row, (name, _)| {
            row.push_bind(run).push_bind(name.as_str()).push_bind(1);
        });
        names.push(" ON CONFLICT (run, name) DO UPDATE SET points = points + 1");
        names.build().execute(&mut *conn).await?;
    }
    thin(conn, run).await
}

/// Deletes every second point of the metrics that have too many, counted from the newest.
async fn thin(conn: &mut SqliteConnection, run: &str) -> Result<(), StoreError> {
    let full: Vec<String> =
        query_scalar!("SELECT name FROM trainer_metric_names WHERE run = ? AND points > ?", run, MAX_POINTS)
            .fetch_all(&mut *conn)
            .await?;
    for name in full {
        query!(
            "DELETE FROM trainer_metrics WHERE run = ?1 AND name = ?2 AND step IN (
                 SELECT step FROM (
                     SELECT step, row_number() OVER (ORDER BY step DESC) AS number FROM trainer_metrics
                     WHERE run = ?1 AND name = ?2)
                 WHERE number % 2 = 0)",
            run,
            name
        )
        .execute(&mut *conn)
        .await?;
        query!(
            "UPDATE trainer_metric_names
             SET points = (SELECT count(*) FROM trainer_metrics WHERE run = ?1 AND name = ?2)
             WHERE run = ?1 AND name = ?2",
            run,
            name
        )
        .execute(&mut *conn)
        .await?;
    }
    Ok(())
}

/// Window of a query of metrics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MetricWindow {
    /// Time of the first report.
    pub from: Millis,
    /// Time of the last report.
    pub to: Millis,
    /// Largest number of points of a metric.
    pub points: u32,
}

/// Reads the points of a run's metrics, or of one, in the order of names and steps. A metric with more reports in the window than
/// `points` has `points` means of successive reports.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn curves(
    conn: &mut SqliteConnection,
    run: &str,
    name: Option<&str>,
    window: MetricWindow,
) -> Result<Vec<MetricPoint>, StoreError> {
    let MetricWindow { from, to, points } = window;
    Ok(sqlx::query_as!(
        MetricPoint,
        r#"SELECT name AS "name!: String", max(step) AS "step!: i64", max(at) AS "at!: i64", avg(value) AS "value: f64",
                  max(value) FILTER (WHERE is_last) AS "last_value: f64" FROM (
               SELECT name, step, at, value, row_number() OVER (PARTITION BY name ORDER BY step DESC) = 1 AS is_last, ntile(?5) OVER (PARTITION BY name ORDER BY step) AS part
               FROM trainer_metrics
               WHERE run = ?1 AND (?2 IS NULL OR name = ?2) AND at BETWEEN ?3 AND ?4)
           GROUP BY name, part ORDER BY name, part"#,
        run,
        name,
        from,
        to,
        points
    )
    .fetch_all(conn)
    .await?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn valid_metric_names_parse_and_others_are_refused() {
        for name in ["a", "0", "train/loss", "env_runners/episode.return-mean:1", &"x".repeat(128)] {
            assert_eq!(name.parse::<MetricName>().map(|name| name.to_string()), Ok(name.to_owned()));
        }
        for name in ["", "/a", "_a", "a b", "a,b", "ä", "a\n", "a\u{7f}", &"x".repeat(129)] {
            assert!(name.parse::<MetricName>().is_err(), "{name}");
        }
    }

    #[tokio::test]
    async fn full_metric_is_thinned_but_keeps_its_newest_point() {
        const POINTS: &str = "
            INSERT INTO runs (id, name, seed, status, settings, created_at) VALUES ('r', 'r', 7, 'active', '{}', 0);
            WITH RECURSIVE n (step) AS (SELECT 1 UNION ALL SELECT step + 1 FROM n WHERE step < 4000)
            INSERT INTO trainer_metrics (run, name, step, at, value) SELECT 'r', 'loss', step, step, step FROM n;
            INSERT INTO trainer_metric_names (run, name, points) VALUES ('r', 'loss', 4000);";
        let folder = tempfile::tempdir().unwrap();
        let mut conn = crate::open_writer(&folder.path().join("db")).await.unwrap();
        sqlx::raw_sql(POINTS).execute(&mut conn).await.unwrap();
        let values = vec![("kl".parse().unwrap(), Some(1.0)), ("loss".parse().unwrap(), Some(4001.0))];
        put(&mut conn, "r", &MetricsAtStep { step: 4001, values }, 4001).await.unwrap();
        let points =
            curves(&mut conn, "r", None, MetricWindow { from: 0, to: 5000, points: 10_000 }).await.unwrap();
        let steps = |name: &str| -> Vec<i64> {
            points.iter().filter(|point| point.name == name).map(|point| point.step).collect()
        };
        assert_eq!(steps("kl"), [4001]);
        assert_eq!(steps("loss"), (1..=4001).step_by(2).collect::<Vec<i64>>());
        let counted =
            sqlx::query_scalar::<_, i64>("SELECT points FROM trainer_metric_names WHERE name = 'loss'");
        assert_eq!(counted.fetch_one(&mut conn).await.unwrap(), 2001);
    }
}
