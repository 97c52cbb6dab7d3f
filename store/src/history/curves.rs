//! Learning curves of a run's tasks: results by episodes instead of by time. Table `task_curves`.
//!
//! A bucket has at least as many episodes as its width, and the next results begin another bucket. They also do so after a pause,
//! so that no bucket has results from before and after one. [`MAX_BUCKETS`] buckets are joined in pairs, and the width doubles: a
//! curve has enough points for a chart from the first seconds of a run to its end, in a few hundred kilobytes.

use std::collections::BTreeMap;

use sqlx::{QueryBuilder, SqliteConnection, query, query_as};

use super::super::{MAX_ROWS, StoreError, from_json, to_json};
use super::HistoryBucket;
use super::read::tasks;
use crate::Millis;

/// Largest number of buckets of a task.
const MAX_BUCKETS: i64 = 1024;
/// Episodes of a bucket before any are joined.
const FIRST_WIDTH: i64 = 4;
/// Time without results after which a bucket begins, milliseconds.
pub const PAUSE: Millis = 60_000;

/// Results of a task in consecutive episodes.
#[derive(Debug, Clone, PartialEq)]
pub struct CurvePoint {
    /// Number of the task's episodes before the point.
    pub first_episode: i64,
    /// Number of episodes in the point: finished, or of accepted claims.
    pub episodes: i64,
    /// Number of environment steps of the task's finished episodes before the point.
    pub first_step: i64,
    /// Time of the first results, milliseconds since 1970-01-01 UTC.
    pub first_at: Millis,
    /// Time of the latest results, milliseconds since 1970-01-01 UTC.
    pub last_at: Millis,
    /// Results of the task in the point.
    pub bucket: HistoryBucket,
}

impl CurvePoint {
    /// The point after `earlier`, or the first one of a curve.
    fn after(earlier: Option<&Self>, now: Millis, part: &HistoryBucket) -> Self {
        Self {
            first_episode: earlier.map_or(0, |at| at.first_episode + at.episodes),
            episodes: 0,
            first_step: earlier.map_or(0, |at| at.first_step + at.bucket.steps),
            first_at: now,
            last_at: now,
            bucket: HistoryBucket::default(),
        }
        .joined_with(now, part)
    }

    /// Adds results of the moment `now`.
    fn joined_with(mut self, now: Millis, part: &HistoryBucket) -> Self {
        self.episodes += part.episodes + part.claimed_episodes;
        // The clock may have been set back.
        self.last_at = self.last_at.max(now);
        self.bucket.join(part);
        self
    }

    /// Adds the next point.
    fn join(&mut self, later: &Self) {
        self.episodes += later.episodes;
        self.last_at = self.last_at.max(later.last_at);
        self.bucket.join(&later.bucket);
    }
}

/// A row of the `task_curves` table, without its run and task.
#[derive(Debug, Clone)]
struct CurveRow {
    ordinal: i64,
    width: i64,
    point: CurvePoint,
}

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
                write_rows(&mut *conn, run, task, &[CurveRow { ordinal: 0, width: FIRST_WIDTH, point }])
                    .await?;
            }
            continue;
        };
        let is_full = last.point.episodes >= last.width;
        let is_after_pause = now - last.point.last_at > PAUSE;
        let row = if part.has_results() && (is_full || is_after_pause) {
            let last = match last.ordinal + 1 < MAX_BUCKETS {
                true => last,
                false => join_pairs(&mut *conn, run, task).await?.unwrap_or(last),
            };
            let point = CurvePoint::after(Some(&last.point), now, part);
            CurveRow { ordinal: last.ordinal + 1, width: last.width, point }
        } else {
            // A sample of mastery does not make a bucket last longer than its results.
            let at = if part.has_results() { now } else { last.point.last_at };
            CurveRow { point: last.point.joined_with(at, part), ..last }
        };
        write_rows(&mut *conn, run, task, &[row]).await?;
    }
    Ok(())
}

/// Joins the buckets of a task in pairs, and doubles their width. Returns the last one.
async fn join_pairs(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Option<CurveRow>, StoreError> {
    let rows = read_rows(&mut *conn, run, task).await?;
    let mut joined: Vec<CurveRow> = Vec::with_capacity(rows.len().div_ceil(2));
    for row in rows {
        let ordinal = row.ordinal / 2;
        match joined.last_mut().filter(|last| last.ordinal == ordinal) {
            Some(last) => last.point.join(&row.point),
            None => joined.push(CurveRow { ordinal, width: 2 * row.width, point: row.point }),
        }
    }
    query!("DELETE FROM task_curves WHERE run = ?1 AND task = ?2", run, task).execute(&mut *conn).await?;
    for rows in joined.chunks(MAX_ROWS) {
        write_rows(&mut *conn, run, task, rows).await?;
    }
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
        let rows = read_rows(&mut *conn, run, &task).await?;
        if !rows.is_empty() {
            curves.insert(task, rows.into_iter().map(|row| row.point).collect());
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
        r#"SELECT min((SELECT first_at FROM task_curves WHERE run = ?1 AND task = value ORDER BY ordinal LIMIT 1))
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

/// Reads the last row of a task.
async fn last_row(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Option<CurveRow>, StoreError> {
    let row = query_as!(
        StoredRow,
        "SELECT ordinal, width, first_episode, episodes, first_step, first_at, last_at, results FROM task_curves
         WHERE run = ?1 AND task = ?2 ORDER BY ordinal DESC LIMIT 1",
        run,
        task
    )
    .fetch_optional(conn)
    .await?;
    row.map(StoredRow::read).transpose()
}

/// Reads all rows of a task, in order of time. In this order the disk reads ahead, so that a database that is not in memory yet
/// answers sooner.
async fn read_rows(conn: &mut SqliteConnection, run: &str, task: &str) -> Result<Vec<CurveRow>, StoreError> {
    let rows = query_as!(
        StoredRow,
        "SELECT ordinal, width, first_episode, episodes, first_step, first_at, last_at, results FROM task_curves
         WHERE run = ?1 AND task = ?2 ORDER BY ordinal",
        run,
        task
    )
    .fetch_all(conn)
    .await?;
    rows.into_iter().map(StoredRow::read).collect()
}

/// A row as it is stored.
struct StoredRow {
    ordinal: i64,
    width: i64,
    first_episode: i64,
    episodes: i64,
    first_step: i64,
    first_at: Millis,
    last_at: Millis,
    results: String,
}

impl StoredRow {
    fn read(self) -> Result<CurveRow, StoreError> {
        let Self { ordinal, width, first_episode, episodes, first_step, first_at, last_at, results } = self;
        let bucket = from_json("a point of a learning curve", &results)?;
        let point = CurvePoint { first_episode, episodes, first_step, first_at, last_at, bucket };
        Ok(CurveRow { ordinal, width, point })
    }
}

/// Writes rows of a task, in place of those with the same ordinals.
async fn write_rows(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    rows: &[CurveRow],
) -> Result<(), StoreError> {
    let results: Vec<String> = rows.iter().map(|row| to_json(&row.point.bucket)).collect::<Result<_, _>>()?;
    let mut statement = QueryBuilder::new(
        "INSERT OR REPLACE INTO task_curves (run, task, ordinal, width, first_episode, episodes, first_step, first_at,
                                             last_at, results) ",
    );
    statement.push_values(rows.iter().zip(&results), |mut values, (row, results)| {
        let CurveRow { ordinal, width, point } = row;
        values.push_bind(run).push_bind(task).push_bind(*ordinal).push_bind(*width);
        values.push_bind(point.first_episode).push_bind(point.episodes).push_bind(point.first_step);
        values.push_bind(point.first_at).push_bind(point.last_at).push_bind(results);
    });
    statement.build().execute(conn).await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::{MasterySample, VersionRange, add};

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
}
