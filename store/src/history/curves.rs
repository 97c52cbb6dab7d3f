//! Learning curves of a run's tasks: results by episodes instead of by time. Module [`curve_rows`](super::curve_rows) stores them.
//!
//! A bucket has at least as many episodes as its width, and the next results begin another bucket. They also do so after a pause,
//! so that no bucket has results from before and after one. [`MAX_BUCKETS`] buckets are joined in pairs, and the width doubles: a
//! curve has enough points for a chart from the first seconds of a run to its end, in a few hundred kilobytes.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::super::{StoreError, from_json};
use super::HistoryBucket;
use super::curve_point::CurvePoint;
use super::curve_rows::{CurveRow, last_row, read_points, replace_rows, write_row};
use super::read::tasks;
use crate::Millis;

/// Largest number of buckets of a task.
const MAX_BUCKETS: i64 = 1024;
/// Episodes of a bucket before any are joined.
const FIRST_WIDTH: i64 = 4;
/// Time without results after which a bucket begins, milliseconds.
pub const PAUSE: Millis = 60_000;

/// Adds the results of a run's tasks at the moment `now` to their curves.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails, and [`StoreError::Corrupt`] if a stored bucket is damaged.
pub(super) async fn add_to_curves(
    conn: &mut SqliteConnection,
    run: &str,
    now: Millis,
    parts: &BTreeMap<String, HistoryBucket>,
) -> Result<(), StoreError> {
    for (task, part) in parts {
        let Some(last) = last_row(&mut *conn, run, task).await? else {
            // A sample of mastery alone begins no curve.
            if part.has_results() {
                let point = CurvePoint::after(None, now, part);
                write_row(&mut *conn, run, task, CurveRow { ordinal: 0, width: FIRST_WIDTH, point }).await?;
            }
            continue;
        };
        let is_full = last.point.episodes >= last.width;
        let is_after_pause = now - last.point.last_at > PAUSE;
        let row = if part.has_results() && (is_full || is_after_pause) {
            let last = match last.ordinal + 1 < MAX_BUCKETS {
                true => last,
                false => join_pairs(&mut *conn, run, task, last.width).await?.unwrap_or(last),
            };
            let point = CurvePoint::after(Some(&last.point), now, part);
            CurveRow { ordinal: last.ordinal + 1, width: last.width, point }
        } else {
            // A sample of mastery does not make a bucket last longer than its results.
            let at = if part.has_results() { now } else { last.point.last_at };
            CurveRow { point: last.point.joined_with(at, part), ..last }
        };
        write_row(&mut *conn, run, task, row).await?;
    }
    Ok(())
}

/// Joins the buckets of a task in pairs, and doubles their `width`. Returns the last one.
async fn join_pairs(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    width: i64,
) -> Result<Option<CurveRow>, StoreError> {
    let mut joined: Vec<CurveRow> = Vec::new();
    for (number, point) in read_points(&mut *conn, run, task).await?.into_iter().enumerate() {
        match joined.last_mut().filter(|_| number % 2 == 1) {
            Some(earlier) => earlier.point.join(&point),
            None => joined.push(CurveRow { ordinal: joined.len() as i64, width: 2 * width, point }),
        }
    }
    replace_rows(conn, run, task, &joined).await?;
    Ok(joined.pop())
}

/// Reads the learning curve of each task of a run that has results, by task.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails, and [`StoreError::Corrupt`] if a stored bucket is damaged.
pub async fn learning_curves(
    conn: &mut SqliteConnection,
    run: &str,
) -> Result<BTreeMap<String, Vec<CurvePoint>>, StoreError> {
    let tasks: Vec<String> = from_json("the tasks of a run", &tasks(&mut *conn, run).await?)?;
    let mut curves = BTreeMap::new();
    for task in tasks {
        let points = read_points(&mut *conn, run, &task).await?;
        if !points.is_empty() {
            curves.insert(task, points);
        }
    }
    Ok(curves)
}

/// Times between which a run had results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ActiveSpan {
    /// Time of the first results, milliseconds since 1970-01-01 UTC.
    pub first_at: Millis,
    /// Time of the latest results, milliseconds since 1970-01-01 UTC.
    pub last_at: Millis,
}

/// Reads when a run had its first and its latest results; none before there are any.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn active_span(conn: &mut SqliteConnection, run: &str) -> Result<Option<ActiveSpan>, StoreError> {
    let tasks = tasks(&mut *conn, run).await?;
    let row = query!(
        r#"SELECT min(coalesce((SELECT first_at FROM task_curve_blocks WHERE run = ?1 AND task = value ORDER BY block LIMIT 1),
                               (SELECT first_at FROM task_curves WHERE run = ?1 AND task = value ORDER BY ordinal LIMIT 1)))
                      AS "first_at: i64",
                  max((SELECT last_at FROM task_curves WHERE run = ?1 AND task = value ORDER BY ordinal DESC LIMIT 1))
                      AS "last_at: i64"
           FROM json_each(?2)"#,
        run,
        tasks
    )
    .fetch_one(conn)
    .await?;
    Ok(row.first_at.zip(row.last_at).map(|(first_at, last_at)| ActiveSpan { first_at, last_at }))
}

/// Joins neighbouring points until there are at most `limit`, of about equal numbers of episodes.
#[must_use]
pub fn thin_curve(points: Vec<CurvePoint>, limit: usize) -> Vec<CurvePoint> {
    if points.len() <= limit {
        return points;
    }
    let all: i64 = points.iter().map(|point| point.episodes).sum();
    let enough = all as f64 / limit.max(1) as f64;
    let mut thinned = Vec::<CurvePoint>::with_capacity(limit + 1);
    for point in points {
        match thinned.last_mut().filter(|last| (last.episodes as f64) < enough) {
            Some(last) => last.join(&point),
            None => thinned.push(point),
        }
    }
    thinned
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::{MasterySample, VersionRange, add};
    use crate::to_json;

    /// Results of one moment of the test.
    fn part(number: i64) -> BTreeMap<String, HistoryBucket> {
        let mastery = MasterySample { level: Some(number / 1000), mean: 0.5, q10: 0.1, q90: 0.9 };
        let bucket = HistoryBucket {
            episodes: 3,
            claimed_episodes: number % 3,
            steps: 10,
            versions: Some(VersionRange::of(number)),
            mastery: Some(mastery),
            ..HistoryBucket::default()
        };
        BTreeMap::from([("task".to_owned(), bucket)])
    }

    /// Opens a new database that has the run `r`.
    async fn open_with_run(path: &std::path::Path) -> SqliteConnection {
        let mut conn = crate::open_writer(path).await.unwrap();
        let run = "INSERT INTO runs (id, name, seed, status, settings, created_at) VALUES ('r', 'r', 7, 'active', '{}', 0)";
        sqlx::raw_sql(run).execute(&mut conn).await.unwrap();
        conn
    }

    #[tokio::test]
    async fn full_curve_is_joined_and_keeps_all_results() {
        let folder = tempfile::tempdir().unwrap();
        let mut conn = open_with_run(&folder.path().join("db")).await;
        let only_mastery = HistoryBucket { mastery: part(0)["task"].mastery, ..HistoryBucket::default() };
        add(&mut conn, "r", 0, &BTreeMap::from([("other".to_owned(), only_mastery)])).await.unwrap();
        let all = 5000;
        for number in 0..all {
            add(&mut conn, "r", 100 * number, &part(number)).await.unwrap();
        }
        let curves = learning_curves(&mut conn, "r").await.unwrap();
        assert_eq!(curves.keys().collect::<Vec<_>>(), ["task"], "mastery alone begins no curve");
        let curve = &curves["task"];
        assert!((512..=1024).contains(&curve.len()), "{}", curve.len());
        for pair in curve.windows(2) {
            let [earlier, later] = pair else { unreachable!() };
            assert_eq!(earlier.first_episode + earlier.episodes, later.first_episode);
            assert_eq!(earlier.first_step + earlier.bucket.steps, later.first_step);
            assert!(earlier.last_at < later.first_at);
            assert_eq!(earlier.bucket.versions.unwrap().high + 1, later.bucket.versions.unwrap().low);
        }
        let episodes: i64 = (0..all).map(|number| 3 + number % 3).sum();
        assert_eq!(curve.iter().map(|point| point.episodes).sum::<i64>(), episodes);
        assert_eq!(curve.last().unwrap().bucket.mastery.unwrap().level, Some(4));
        let span = active_span(&mut conn, "r").await.unwrap().unwrap();
        assert_eq!((span.first_at, span.last_at), (0, 100 * (all - 1)));
        assert_eq!(active_span(&mut conn, "other").await.unwrap(), None);
        let rows = "SELECT count(*) FROM task_curves";
        let rows: i64 = sqlx::query_scalar(rows).fetch_one(&mut conn).await.unwrap();
        assert!((1..=32).contains(&rows), "{rows} buckets have a row of their own");
        let thinned = thin_curve(curve.clone(), 100);
        assert!((90..=101).contains(&thinned.len()), "{}", thinned.len());
        assert_eq!(thinned.iter().map(|point| point.episodes).sum::<i64>(), episodes);
    }

    #[test]
    fn stored_buckets_have_no_zeros_and_keep_lowest_levels() {
        assert_eq!(to_json(&HistoryBucket::default()).unwrap(), "{}");
        let bucket = HistoryBucket {
            lowest_level: Some(0),
            versions: Some(VersionRange::of(0)),
            ..HistoryBucket::default()
        };
        let stored = to_json(&bucket).unwrap();
        assert_eq!(stored, r#"{"versions":{"low":0,"high":0},"lowest_level":0}"#);
        assert_eq!(from_json::<HistoryBucket>("a bucket", &stored).unwrap(), bucket);
    }

    #[tokio::test]
    async fn results_after_a_pause_begin_a_bucket() {
        let folder = tempfile::tempdir().unwrap();
        let mut conn = open_with_run(&folder.path().join("db")).await;
        for at in [0, 1_000, 2_000 + PAUSE, 3_000 + PAUSE, 1_500 + PAUSE] {
            add(&mut conn, "r", at, &part(0)).await.unwrap();
        }
        let curve = learning_curves(&mut conn, "r").await.unwrap().remove("task").unwrap();
        let spans: Vec<_> =
            curve.iter().map(|point| (point.first_at, point.last_at, point.episodes)).collect();
        assert_eq!(
            spans,
            [(0, 1_000, 6), (2_000 + PAUSE, 3_000 + PAUSE, 6), (1_500 + PAUSE, 1_500 + PAUSE, 3)]
        );
    }

    /// Buckets that an earlier schema stored in a row each are packed with the next block.
    #[tokio::test]
    async fn rows_of_an_earlier_schema_are_packed() {
        let folder = tempfile::tempdir().unwrap();
        let mut conn = open_with_run(&folder.path().join("db")).await;
        add(&mut conn, "r", 0, &part(0)).await.unwrap();
        add(&mut conn, "r", 1, &part(0)).await.unwrap();
        let rows = "WITH RECURSIVE n (o) AS (SELECT 1 UNION ALL SELECT o + 1 FROM n WHERE o < 94)
                    INSERT OR REPLACE INTO task_curves SELECT run, task, o, width, first_episode + 6 * o, 6, first_step + 20 * o, o, o, results
                    FROM task_curves, n WHERE ordinal = 0";
        sqlx::raw_sql(rows).execute(&mut conn).await.unwrap();
        let before = learning_curves(&mut conn, "r").await.unwrap();
        for number in 95..97 {
            add(&mut conn, "r", number, &part(2)).await.unwrap();
        }
        let blocks = "SELECT count(*) FROM task_curve_blocks";
        let blocks: i64 = sqlx::query_scalar(blocks).fetch_one(&mut conn).await.unwrap();
        assert_eq!(blocks, 3);
        let after = learning_curves(&mut conn, "r").await.unwrap();
        assert_eq!((before["task"].len(), after["task"].len()), (95, 97));
        assert_eq!(before["task"], after["task"][..95]);
        assert_eq!(active_span(&mut conn, "r").await.unwrap().unwrap().first_at, 0);
    }
}
