//! Reads a window of a run's history as a limited number of points.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::super::StoreError;
use super::{DurationSum, HOUR, HistoryBucket, MINUTE, MINUTES_KEPT, MasterySample, ParamRange};
use crate::Millis;

/// A window of time, and the width of its points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HistoryWindow {
    /// Begin, milliseconds since 1970-01-01 UTC: a multiple of `width`.
    pub from: Millis,
    /// End, milliseconds since 1970-01-01 UTC.
    pub to: Millis,
    /// Width of a point, milliseconds: a multiple of the stored width.
    pub width: Millis,
    /// Width of the buckets that are read, milliseconds.
    pub(super) stored: Millis,
}

impl HistoryWindow {
    /// The window from `from` to `to` with at most `points` points. It is read from buckets of a minute if points are at most an hour
    /// wide and the minutes are still kept at `now`, else from buckets of an hour. One point more may be needed for a begin that is
    /// not a multiple of the width.
    #[must_use]
    pub fn new(from: Millis, to: Millis, points: i64, now: Millis) -> Self {
        let each = (to - from).max(1).unsigned_abs().div_ceil(points.max(1).unsigned_abs());
        let each = i64::try_from(each).unwrap_or(i64::MAX / 2);
        // Points of several hours need no minutes, of which there are sixty times as many.
        let stored = if from >= now - MINUTES_KEPT + HOUR && each <= HOUR { MINUTE } else { HOUR };
        let width = (each.saturating_add(stored - 1)) / stored * stored;
        Self { from: from.div_euclid(width) * width, to, width, stored }
    }

    /// True if the points are made of buckets of an hour.
    #[must_use]
    pub const fn is_of_hours(&self) -> bool {
        self.stored == HOUR
    }
}

/// A point of a task's history.
#[derive(Debug, Clone, PartialEq)]
pub struct HistoryPoint {
    /// Id of the task.
    pub task: String,
    /// Begin of the point, milliseconds since 1970-01-01 UTC.
    pub start: Millis,
    /// Results of the task in the point.
    pub bucket: HistoryBucket,
}

/// Reads a run's history in a window, by task and time. Points without results are left out.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn curve(
    conn: &mut SqliteConnection,
    run: &str,
    window: HistoryWindow,
) -> Result<Vec<HistoryPoint>, StoreError> {
    let HistoryWindow { from, to, width, stored } = window;
    let tasks = tasks(&mut *conn, run).await?;
    let rows = query!(
        r#"SELECT task AS "task!", start / ?5 * ?5 AS "bucket!: i64", max(start) AS "last!: i64",
                  sum(episodes) AS "episodes!: i64", sum(successes) AS "successes!: i64", sum(score_sum) AS "score_sum!: f64",
                  sum(episodes_with_skill) AS "episodes_with_skill!: i64", sum(skill_sum) AS "skill_sum!: f64",
                  sum(failed) AS "failed!: i64", sum(expired) AS "expired!: i64",
                  sum(contested_groups) AS "contested_groups!: i64", sum(success_rate_sum) AS "success_rate_sum!: f64",
                  sum(panel_groups) AS "panel_groups!: i64", sum(panel_success_rate_sum) AS "panel_success_rate_sum!: f64",
                  sum(groups) AS "groups!: i64", sum(zero_variance_groups) AS "zero_variance_groups!: i64",
                  sum(claimed_episodes) AS "claimed_episodes!: i64", sum(timed_episodes) AS "timed_episodes!: i64",
                  sum(time_s_sum) AS "time_s_sum!: f64", min(lowest_level) AS "lowest_level: i64",
                  max(highest_level) AS "highest_level: i64"
           FROM task_history WHERE run = ?1 AND task IN (SELECT value FROM json_each(?6))
                AND width = ?2 AND start >= ?3 AND start < ?4
           GROUP BY 1, 2 ORDER BY 1, 2"#,
        run,
        stored,
        from,
        to,
        width,
        tasks
    )
    .fetch_all(&mut *conn)
    .await?;
    let mut mastery = mastery(conn, run, &tasks, window).await?;
    let mut params = params(conn, run, &tasks, window).await?;
    let points = rows.into_iter().map(|r| {
        let key = (r.task.clone(), r.bucket);
        let bucket = HistoryBucket {
            episodes: r.episodes,
            successes: r.successes,
            score_sum: r.score_sum,
            episodes_with_skill: r.episodes_with_skill,
            skill_sum: r.skill_sum,
            failed: r.failed,
            expired: r.expired,
            contested_groups: r.contested_groups,
            success_rate_sum: r.success_rate_sum,
            panel_groups: r.panel_groups,
            panel_success_rate_sum: r.panel_success_rate_sum,
            groups: r.groups,
            zero_variance_groups: r.zero_variance_groups,
            claimed_episodes: r.claimed_episodes,
            durations: DurationSum { episodes: r.timed_episodes, seconds: r.time_s_sum },
            lowest_level: r.lowest_level,
            highest_level: r.highest_level,
            mastery: mastery.remove(&key),
            params: params.remove(&key).unwrap_or_default(),
            ..HistoryBucket::default()
        };
        HistoryPoint { task: r.task, start: r.bucket, bucket }
    });
    Ok(points.collect())
}

/// Reads the tasks that have a history, as a JSON list.
///
/// There are few tasks and many buckets: the statement steps from one task to the next instead of reading all buckets.
pub(crate) async fn tasks(conn: &mut SqliteConnection, run: &str) -> Result<String, StoreError> {
    let row = query!(
        r#"WITH RECURSIVE known (task) AS (
               SELECT min(task) FROM task_history WHERE run = ?1
               UNION ALL
               SELECT (SELECT min(h.task) FROM task_history h WHERE h.run = ?1 AND h.task > known.task) FROM known
               WHERE known.task IS NOT NULL
           )
           SELECT json_group_array(task) AS "tasks!: String" FROM known WHERE task IS NOT NULL"#,
        run
    )
    .fetch_one(conn)
    .await?;
    Ok(row.tasks)
}

/// Values by task and begin of the point.
type ByPoint<T> = BTreeMap<(String, Millis), T>;

/// Reads the last mastery estimate in each point.
async fn mastery(
    conn: &mut SqliteConnection,
    run: &str,
    tasks: &str,
    window: HistoryWindow,
) -> Result<ByPoint<MasterySample>, StoreError> {
    let HistoryWindow { from, to, width, stored } = window;
    // With a `max`, SQLite takes the other columns from the row that has it ("bare columns in an aggregate query").
    let rows = query!(
        r#"SELECT task AS "task!", start / ?5 * ?5 AS "bucket!: i64", max(start) AS "last!: i64", level, mean AS "mean!: f64",
                  q10 AS "q10!: f64", q90 AS "q90!: f64"
           FROM task_history WHERE run = ?1 AND task IN (SELECT value FROM json_each(?6))
                AND width = ?2 AND start >= ?3 AND start < ?4 AND mean IS NOT NULL
           GROUP BY 1, 2"#,
        run,
        stored,
        from,
        to,
        width,
        tasks
    )
    .fetch_all(conn)
    .await?;
    let samples = rows.into_iter().map(|r| {
        ((r.task, r.bucket), MasterySample { level: r.level, mean: r.mean, q10: r.q10, q90: r.q90 })
    });
    Ok(samples.collect())
}

/// Reads the parameters of the scenarios in each point, by name.
async fn params(
    conn: &mut SqliteConnection,
    run: &str,
    tasks: &str,
    window: HistoryWindow,
) -> Result<ByPoint<BTreeMap<String, ParamRange>>, StoreError> {
    let HistoryWindow { from, to, width, stored } = window;
    let rows = query!(
        r#"SELECT task AS "task!", start / ?5 * ?5 AS "bucket!: i64", param AS "param!", sum(n) AS "n!: i64", sum(total) AS "total!: f64",
                  min(low) AS "low!: f64", max(high) AS "high!: f64"
           FROM task_history_params WHERE run = ?1 AND task IN (SELECT value FROM json_each(?6))
                AND width = ?2 AND start >= ?3 AND start < ?4
           GROUP BY 1, 2, 3"#,
        run,
        stored,
        from,
        to,
        width,
        tasks
    )
    .fetch_all(conn)
    .await?;
    let mut params = ByPoint::<BTreeMap<String, ParamRange>>::new();
    for r in rows {
        let range = ParamRange { n: r.n, total: r.total, low: r.low, high: r.high };
        params.entry((r.task, r.bucket)).or_default().insert(r.param, range);
    }
    Ok(params)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// A window has no more points than requested, and at most one besides for its unaligned begin.
        #[test]
        fn window_has_at_most_one_extra_point(from in 0_i64..1 << 41, long in 0_i64..1 << 36, points in 1_i64..2000, age in 0_i64..1 << 36) {
            let to = from + long;
            let window = HistoryWindow::new(from, to, points, to + age);
            prop_assert!(window.from <= from && from - window.from < window.width);
            prop_assert_eq!(window.width % window.stored, 0);
            prop_assert!((window.to - window.from) / window.width <= points + 1);
        }
    }
}
