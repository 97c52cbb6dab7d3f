//! Reading history: a stretch of it in so many points.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::super::StoreError;
use super::{HOUR, MINUTE, MINUTES_KEPT, Part, Spread, Standing};
use crate::clock::Millis;

/// A stretch of time, and the width of its buckets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Its beginning: a multiple of the width.
    pub from: Millis,
    /// Its end.
    pub to: Millis,
    /// How long a bucket is: a multiple of what is stored.
    pub width: Millis,
    /// What is stored that long.
    stored: Millis,
}

impl Window {
    /// From here to there in at most so many buckets, as they can be told now.
    #[must_use]
    pub fn of((from, to): (Millis, Millis), points: i64, now: Millis) -> Self {
        let stored = if from >= now - MINUTES_KEPT + HOUR { MINUTE } else { HOUR };
        let each = (to - from).max(1).unsigned_abs().div_ceil(points.max(1).unsigned_abs());
        let each = i64::try_from(each).unwrap_or(i64::MAX / 2);
        let width = (each.saturating_add(stored - 1)) / stored * stored;
        Self { from: from.div_euclid(width) * width, to, width, stored }
    }
}

/// A bucket of a task's history.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// The task.
    pub task: String,
    /// Where it begins.
    pub start: Millis,
    /// What came of it.
    pub part: Part,
}

/// A run's history in a window, by task and time; buckets in which nothing came are left out.
///
/// # Errors
/// The database's.
pub async fn curve(conn: &mut SqliteConnection, run: &str, window: Window) -> Result<Vec<Point>, StoreError> {
    let Window { from, to, width, stored } = window;
    let tasks = tasks(&mut *conn, run).await?;
    let rows = query!(
        r#"SELECT task AS "task!", start / ?5 * ?5 AS "bucket!: i64", max(start) AS "last!: i64",
                  sum(episodes) AS "episodes!: i64", sum(successes) AS "successes!: i64", sum(score) AS "score!: f64",
                  sum(skilled) AS "skilled!: i64", sum(skill) AS "skill!: f64", sum(failed) AS "failed!: i64",
                  sum(expired) AS "expired!: i64", sum(contested) AS "contested!: i64", sum(solved) AS "solved!: f64",
                  sum(panels) AS "panels!: i64", sum(panel) AS "panel!: f64", sum(groups) AS "groups!: i64",
                  sum(flat) AS "flat!: i64", sum(claimed) AS "claimed!: i64", min(low) AS "low: i64", max(high) AS "high: i64"
           FROM history WHERE run = ?1 AND task IN (SELECT value FROM json_each(?6))
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
    let (mut standings, mut params) =
        (standings(conn, run, &tasks, window).await?, spreads(conn, run, &tasks, window).await?);
    let points = rows.into_iter().map(|r| {
        let key = (r.task.clone(), r.bucket);
        let part = Part {
            episodes: r.episodes,
            successes: r.successes,
            score: r.score,
            skilled: r.skilled,
            skill: r.skill,
            failed: r.failed,
            expired: r.expired,
            contested: r.contested,
            solved: r.solved,
            panels: r.panels,
            panel: r.panel,
            groups: r.groups,
            flat: r.flat,
            claimed: r.claimed,
            low: r.low,
            high: r.high,
            standing: standings.remove(&key),
            params: params.remove(&key).unwrap_or_default(),
        };
        Point { task: r.task, start: r.bucket, part }
    });
    Ok(points.collect())
}

/// The tasks of which a run has a history, as a list in JSON. They are few: it is stepped from one to the next, not read through all of their
/// buckets.
pub(super) async fn tasks(conn: &mut SqliteConnection, run: &str) -> Result<String, StoreError> {
    let row = query!(
        r#"WITH RECURSIVE known (task) AS (
               SELECT min(task) FROM history WHERE run = ?1
               UNION ALL
               SELECT (SELECT min(h.task) FROM history h WHERE h.run = ?1 AND h.task > known.task) FROM known
               WHERE known.task IS NOT NULL
           )
           SELECT json_group_array(task) AS "tasks!: String" FROM known WHERE task IS NOT NULL"#,
        run
    )
    .fetch_one(conn)
    .await?;
    Ok(row.tasks)
}

type Buckets<T> = BTreeMap<(String, Millis), T>;

/// Where tasks stood at the end of each bucket.
async fn standings(
    conn: &mut SqliteConnection,
    run: &str,
    tasks: &str,
    window: Window,
) -> Result<Buckets<Standing>, StoreError> {
    let Window { from, to, width, stored } = window;
    // Where there is a max, SQLite takes the other columns from the row that has it ("bare columns in an aggregate query").
    let rows = query!(
        r#"SELECT task AS "task!", start / ?5 * ?5 AS "bucket!: i64", max(start) AS "last!: i64", level, mean AS "mean!: f64",
                  q10 AS "q10!: f64", q90 AS "q90!: f64"
           FROM history WHERE run = ?1 AND task IN (SELECT value FROM json_each(?6))
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
    let of = rows
        .into_iter()
        .map(|r| ((r.task, r.bucket), Standing { level: r.level, mean: r.mean, q10: r.q10, q90: r.q90 }));
    Ok(of.collect())
}

async fn spreads(
    conn: &mut SqliteConnection,
    run: &str,
    tasks: &str,
    window: Window,
) -> Result<Buckets<BTreeMap<String, Spread>>, StoreError> {
    let Window { from, to, width, stored } = window;
    let rows = query!(
        r#"SELECT task AS "task!", start / ?5 * ?5 AS "bucket!: i64", param AS "param!", sum(n) AS "n!: i64", sum(total) AS "total!: f64",
                  min(low) AS "low!: f64", max(high) AS "high!: f64"
           FROM history_params WHERE run = ?1 AND task IN (SELECT value FROM json_each(?6))
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
    let mut spreads = Buckets::<BTreeMap<String, Spread>>::new();
    for r in rows {
        let spread = Spread { n: r.n, total: r.total, low: r.low, high: r.high };
        spreads.entry((r.task, r.bucket)).or_default().insert(r.param, spread);
    }
    Ok(spreads)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// However long a window is, it has no more buckets than were asked for, and one at most besides for its ragged beginning.
        #[test]
        fn a_window_has_as_many_buckets_as_were_asked_for(from in 0_i64..1 << 41, long in 0_i64..1 << 36, points in 1_i64..2000, age in 0_i64..1 << 36) {
            let to = from + long;
            let window = Window::of((from, to), points, to + age);
            prop_assert!(window.from <= from && from - window.from < window.width);
            prop_assert_eq!(window.width % window.stored, 0);
            prop_assert!((window.to - window.from) / window.width <= points + 1);
        }
    }
}
