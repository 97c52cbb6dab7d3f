//! Results of a run over time or over episodes, as a limited number of points.

use std::collections::BTreeMap;

use clock::Millis;
use sqlx::SqliteConnection;
use store::StoreError;
use store::history::{
    self, CurvePoint, HistoryBucket, HistoryPoint, HistoryWindow, MasterySample, PAUSE, RungPoint, thin_curve,
};

/// Share of the requested points below which minutes and hours are too coarse for a chart, as a divisor.
const COARSE: usize = 4;

/// Part of a series that a point covers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeriesResolution {
    /// Points are consecutive episodes.
    Episodes,
    /// Points are intervals of whole minutes.
    Minutes,
    /// Points are intervals of whole hours.
    Hours,
}

/// Contents of the points of a series.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeriesContent {
    /// Results, and those by rung only where points are consecutive episodes.
    Results,
    /// Results, and those by rung.
    Rungs,
}

/// Results of a task in a part of a series.
#[derive(Debug, Clone, PartialEq)]
pub struct SeriesPoint {
    /// Begin of the part, milliseconds since 1970-01-01 UTC.
    pub from: Millis,
    /// End of the part, milliseconds since 1970-01-01 UTC.
    pub to: Millis,
    /// Episodes and steps before the part; none where points are intervals of time.
    pub position: Option<CurvePosition>,
    /// Results in the part; empty at the borders of a gap without results.
    pub bucket: HistoryBucket,
}

/// Position of a point on a learning curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CurvePosition {
    /// Number of the task's episodes before the point.
    pub first_episode: i64,
    /// Number of the environment steps of the task's episodes before the point.
    pub first_step: i64,
}

/// Results of a run's tasks.
#[derive(Debug, Clone, PartialEq)]
pub struct RunPoints {
    /// Begin of the window, milliseconds since 1970-01-01 UTC.
    pub from: Millis,
    /// End of the window, milliseconds since 1970-01-01 UTC.
    pub to: Millis,
    /// Part that a point covers.
    pub resolution: SeriesResolution,
    /// Points of each task that has results, in order.
    pub tasks: BTreeMap<String, Vec<SeriesPoint>>,
}

impl RunPoints {
    /// Replaces the mastery of each task's last point by the current one: the stored sample may be some seconds older than the last
    /// results.
    pub fn set_current_mastery(&mut self, current: &BTreeMap<String, MasterySample>) {
        for (task, points) in &mut self.tasks {
            if let Some((last, sample)) = points.last_mut().zip(current.get(task)) {
                last.bucket.mastery = Some(*sample);
            }
        }
    }
}

/// Reads the results of a run in a window of time, as about `limit` points of each task.
///
/// Points are intervals of whole minutes or hours. If that makes few of them, as in a run of some minutes, they are those of the
/// learning curves.
///
/// # Errors
/// Returns [`StoreError`] if the database fails or a stored value is damaged.
pub async fn points_over_time(
    conn: &mut SqliteConnection,
    run: &str,
    window: HistoryWindow,
    limit: usize,
    content: SeriesContent,
) -> Result<RunPoints, StoreError> {
    let HistoryWindow { from, to, .. } = window;
    let mut points = history::curve(&mut *conn, run, window).await?;
    if content == SeriesContent::Rungs {
        add_rungs(&mut points, history::rung_points(&mut *conn, run, window).await?);
    }
    let tasks = intervals_by_task(points, window);
    if most_points(&tasks) < limit.div_ceil(COARSE) {
        let mut curves = history::learning_curves(conn, run).await?;
        for curve in curves.values_mut() {
            curve.retain(|point| point.last_at >= from && point.first_at <= to);
        }
        curves.retain(|_, curve| !curve.is_empty());
        let curves = curves.into_iter().map(|(task, curve)| (task, with_gaps(points_of_curve(curve, limit))));
        let curves: BTreeMap<_, _> = curves.collect();
        if has_results_of(&curves, &tasks) && most_points(&curves) > most_points(&tasks) {
            return Ok(RunPoints { from, to, resolution: SeriesResolution::Episodes, tasks: curves });
        }
    }
    let resolution = if window.is_of_hours() { SeriesResolution::Hours } else { SeriesResolution::Minutes };
    Ok(RunPoints { from, to, resolution, tasks })
}

/// Range of the episodes of each task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EpisodeRange {
    /// Number of episodes before the range.
    pub from: i64,
    /// Number of episodes before its end.
    pub to: i64,
}

/// Reads the learning curves of a run in a range of episodes, as at most `limit` points of each task and one besides.
///
/// # Errors
/// Returns [`StoreError`] if the database fails or a stored value is damaged.
pub async fn points_over_episodes(
    conn: &mut SqliteConnection,
    run: &str,
    range: EpisodeRange,
    limit: usize,
) -> Result<BTreeMap<String, Vec<SeriesPoint>>, StoreError> {
    let mut curves = history::learning_curves(conn, run).await?;
    for curve in curves.values_mut() {
        let is_shown = |point: &CurvePoint| {
            point.first_episode + point.episodes >= range.from && point.first_episode <= range.to
        };
        curve.retain(is_shown);
    }
    curves.retain(|_, curve| !curve.is_empty());
    Ok(curves.into_iter().map(|(task, curve)| (task, points_of_curve(curve, limit))).collect())
}

/// True if the curves have as many episodes as the intervals: results of older versions of the server are in no curve.
fn has_results_of(
    curves: &BTreeMap<String, Vec<SeriesPoint>>,
    intervals: &BTreeMap<String, Vec<SeriesPoint>>,
) -> bool {
    let episodes = |points: &[SeriesPoint]| -> i64 {
        points.iter().map(|point| point.bucket.episodes + point.bucket.claimed_episodes).sum()
    };
    let has = |(task, of_task): (&String, &Vec<SeriesPoint>)| {
        curves.get(task).is_some_and(|curve| episodes(curve) >= episodes(of_task))
    };
    intervals.iter().all(has)
}

/// Largest number of points of a task.
fn most_points(tasks: &BTreeMap<String, Vec<SeriesPoint>>) -> usize {
    tasks.values().map(Vec::len).max().unwrap_or(0)
}

/// Adds the results by rung to the points of their task and time.
fn add_rungs(points: &mut [HistoryPoint], rungs: Vec<RungPoint>) {
    let place = |point: &HistoryPoint| (point.task.clone(), point.start);
    for RungPoint { task, start, key, results } in rungs {
        // Both are in order of task and time.
        if let Ok(at) = points.binary_search_by_key(&(task, start), place) {
            points[at].bucket.add_rung(key, results);
        }
    }
}

/// Points that are intervals of time, by task.
fn intervals_by_task(points: Vec<HistoryPoint>, window: HistoryWindow) -> BTreeMap<String, Vec<SeriesPoint>> {
    let mut tasks = BTreeMap::<String, Vec<SeriesPoint>>::new();
    for HistoryPoint { task, start, bucket } in points {
        // The last interval has not ended.
        let to = (start + window.width).min(window.to.max(start));
        let point = SeriesPoint { from: start, to, position: None, bucket };
        tasks.entry(task).or_default().push(point);
    }
    tasks.into_iter().map(|(task, points)| (task, with_gaps(points))).collect()
}

/// Points of a learning curve. A point begins with the end of the earlier one, unless there was a pause. Mastery is sampled at
/// intervals, and holds until the next sample.
fn points_of_curve(curve: Vec<CurvePoint>, limit: usize) -> Vec<SeriesPoint> {
    let (mut last_at, mut mastery) = (None, None);
    let points = thin_curve(curve, limit).into_iter().map(|point| {
        let CurvePoint { first_episode, first_step, first_at, last_at: to, mut bucket, .. } = point;
        mastery = bucket.mastery.or(mastery);
        bucket.mastery = mastery;
        let is_next = |last: &Millis| first_at - last <= PAUSE;
        let from = last_at.replace(to).filter(is_next).unwrap_or(first_at);
        SeriesPoint { from, to, position: Some(CurvePosition { first_episode, first_step }), bucket }
    });
    points.collect()
}

/// Adds an empty point at the begin and at the end of each gap without results, since a line across it would show values that were
/// never measured.
fn with_gaps(points: Vec<SeriesPoint>) -> Vec<SeriesPoint> {
    let mut all = Vec::<SeriesPoint>::with_capacity(points.len());
    for point in points {
        if let Some(to) = all.last().map(|last| last.to).filter(|to| *to < point.from) {
            for at in [to, point.from] {
                let bucket = HistoryBucket::default();
                all.push(SeriesPoint { from: at, to: at, position: point.position, bucket });
            }
        }
        all.push(point);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(from: Millis, to: Millis, episodes: i64) -> SeriesPoint {
        let bucket = HistoryBucket { episodes, ..HistoryBucket::default() };
        SeriesPoint { from, to, position: None, bucket }
    }

    #[test]
    fn gap_has_an_empty_point_at_each_end() {
        let points = with_gaps(vec![point(0, 60, 1), point(60, 120, 2), point(300, 360, 3)]);
        let shown: Vec<(Millis, i64)> =
            points.iter().map(|point| (point.from, point.bucket.episodes)).collect();
        assert_eq!(shown, [(0, 1), (60, 2), (120, 0), (300, 0), (300, 3)]);
    }

    #[test]
    fn curves_without_earlier_results_are_incomplete() {
        let of = |points: &[SeriesPoint]| BTreeMap::from([("task".to_owned(), points.to_vec())]);
        let intervals = of(&[point(0, 60, 3), point(60, 120, 4)]);
        assert!(has_results_of(&of(&[point(10, 20, 3), point(70, 90, 4)]), &intervals));
        assert!(!has_results_of(&of(&[point(70, 80, 2), point(80, 90, 2)]), &intervals));
        assert!(!has_results_of(&BTreeMap::new(), &intervals));
    }

    #[test]
    fn points_of_a_curve_join_unless_there_was_a_pause() {
        let of = |first_at, last_at| CurvePoint {
            first_episode: 0,
            episodes: 4,
            first_step: 0,
            first_at,
            last_at,
            bucket: HistoryBucket::default(),
        };
        let points = points_of_curve(vec![of(0, 10), of(20, 30), of(31 + PAUSE, 40 + PAUSE)], 10);
        let spans: Vec<(Millis, Millis)> = points.iter().map(|point| (point.from, point.to)).collect();
        assert_eq!(spans, [(0, 10), (10, 30), (31 + PAUSE, 40 + PAUSE)]);
    }
}
