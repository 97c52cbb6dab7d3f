//! Points of a run's series, as its query asks for them.

use api_types::{SeriesAxis, SeriesQuery};
use clock::Millis;
use sqlx::SqliteConnection;
use store::history::HistoryWindow;
use store::ids::RunId;

use super::time_window::{TimeWindow, read_points};
use crate::http::problem::Problem;
use crate::queries::run_series::{
    EpisodeRange, RunPoints, SeriesContent, SeriesPoint, SeriesResolution, points_over_episodes,
    points_over_time,
};

/// Points of a run.
#[derive(Debug)]
pub(super) struct CurrentPoints {
    /// The points, by task.
    pub(super) points: RunPoints,
    /// True if the last points reach to the present.
    pub(super) is_current: bool,
}

/// Reads the points that a query asks for.
///
/// # Errors
/// Returns a problem that names the field if the query is invalid, or a problem of the database.
pub(super) async fn read_run_points(
    conn: &mut SqliteConnection,
    run: &RunId,
    query: &SeriesQuery,
    content: SeriesContent,
    now: Millis,
) -> Result<CurrentPoints, Problem> {
    match query.by.unwrap_or_default() {
        SeriesAxis::Time => read_over_time(conn, run, query, content, now).await,
        SeriesAxis::Episodes => read_over_episodes(conn, run, query, now).await,
    }
}

/// Reads the points over time.
async fn read_over_time(
    conn: &mut SqliteConnection,
    run: &RunId,
    query: &SeriesQuery,
    content: SeriesContent,
    now: Millis,
) -> Result<CurrentPoints, Problem> {
    for (field, value) in [("from_episode", query.from_episode), ("to_episode", query.to_episode)] {
        if value.is_some() {
            return Err(Problem::invalid("by", format!("must be `episodes` with `{field}`")));
        }
    }
    let TimeWindow { from, to } =
        TimeWindow::read(conn, run, query.from.as_ref(), query.to.as_ref(), now).await?;
    let limit = read_points(query.points)?;
    let window = HistoryWindow::new(from, to, i64::from(limit), now);
    let points = points_over_time(conn, run.as_str(), window, limit as usize, content).await?;
    Ok(CurrentPoints { points, is_current: to >= now })
}

/// Reads the points over episodes.
async fn read_over_episodes(
    conn: &mut SqliteConnection,
    run: &RunId,
    query: &SeriesQuery,
    now: Millis,
) -> Result<CurrentPoints, Problem> {
    for (field, value) in [("from", &query.from), ("to", &query.to)] {
        if value.is_some() {
            return Err(Problem::invalid(
                field,
                "is a time, and `by` is `episodes`: use `from_episode` and `to_episode`".to_owned(),
            ));
        }
    }
    let range = EpisodeRange {
        from: query.from_episode.map_or(0, i64::from),
        to: query.to_episode.map_or(i64::MAX, i64::from),
    };
    if range.to < range.from {
        return Err(Problem::invalid(
            "to_episode",
            format!("must be at least `from_episode`, {}", range.from),
        ));
    }
    let limit = read_points(query.points)? as usize;
    let tasks = points_over_episodes(conn, run.as_str(), range, limit).await?;
    let ends = |end: fn(&SeriesPoint) -> Millis| tasks.values().flatten().map(end);
    let (from, to) = (ends(|point| point.from).min(), ends(|point| point.to).max());
    let points = RunPoints {
        from: from.unwrap_or(now),
        to: to.unwrap_or(now),
        resolution: SeriesResolution::Episodes,
        tasks,
    };
    Ok(CurrentPoints { points, is_current: query.to_episode.is_none() })
}
