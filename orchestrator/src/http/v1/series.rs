//! A run over time.

use std::collections::BTreeMap;

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::super::extract::{Path, Query};
use super::super::problem::Problem;
use super::{reader_of, run_id};
use crate::clock::{Millis, rfc3339};
use crate::http::state::AppState;
use crate::store::history::{self, HistoryBucket, HistoryPoint, HistoryWindow};
use crate::store::runs;
use crate::queries::standing::{CurrentStanding, update_last_points};

/// Points of a curve unless told.
const POINTS: u32 = 300;
const MOST: u32 = 2000;

/// Which stretch, how fine.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct Which {
    /// Its beginning, RFC 3339 (that of the run).
    #[param(example = "2026-01-01T00:00:00Z")]
    from: Option<String>,
    /// Its end, RFC 3339 (now).
    to: Option<String>,
    /// Points of each curve, at most: 1 to 2 000 (300).
    points: Option<u32>,
}

/// A stretch of a run's history.
#[derive(Serialize, ToSchema)]
pub(super) struct Series {
    /// Where it begins, RFC 3339.
    from: String,
    /// Where it ends, RFC 3339.
    to: String,
    /// How long a point is, seconds: a multiple of 60 in the last week, else of 3 600.
    width_s: i64,
    /// The tasks of which something came in it.
    tasks: Vec<TaskSeries>,
}

/// Columns over time, all of one length. What nothing is known of is null.
#[derive(Default, Serialize, ToSchema)]
struct TaskSeries {
    /// The task.
    task: String,
    /// Where each point begins, seconds since 1970.
    at: Vec<i64>,
    /// Episodes that finished.
    episodes: Vec<i64>,
    /// Episodes claimed in columns, and accepted.
    claimed: Vec<i64>,
    /// Episodes that failed or never came back.
    lost: Vec<i64>,
    /// Share of successes over all episodes.
    success: Vec<Option<f64>>,
    /// Mean score over all episodes.
    score: Vec<Option<f64>>,
    /// Mean skill where scenarios define one.
    skill: Vec<Option<f64>>,
    /// Mean success on contested scenarios.
    contested: Vec<Option<f64>>,
    /// How many contested scenarios that rests on.
    contested_n: Vec<i64>,
    /// Mean success of the plans that look at nothing, on some of those scenarios.
    panel: Vec<Option<f64>>,
    /// Share of the groups of several episodes whose episodes all have the same score.
    zero_variance: Vec<Option<f64>>,
    /// The lowest level of what came back.
    low: Vec<Option<i64>>,
    /// The highest.
    high: Vec<Option<i64>>,
    /// The level at the end of the point.
    level: Vec<Option<i64>>,
    /// The posterior over success on contested scenarios of that level, then: its mean.
    mastery: Vec<Option<f64>>,
    /// Its 10 % quantile.
    mastery_low: Vec<Option<f64>>,
    /// Its 90 % quantile.
    mastery_high: Vec<Option<f64>>,
    /// The params of what came back.
    params: BTreeMap<String, ParamSeries>,
}

/// A param over time.
#[derive(Default, Serialize, ToSchema)]
struct ParamSeries {
    /// Its mean.
    mean: Vec<Option<f64>>,
    /// The least.
    low: Vec<Option<f64>>,
    /// The most.
    high: Vec<Option<f64>>,
}

impl TaskSeries {
    fn push(&mut self, start: Millis, part: &HistoryBucket) {
        let over = |sum: f64, n: i64| (n > 0).then(|| sum / n as f64);
        let standing = part.mastery;
        self.at.push(start.div_euclid(1000));
        self.episodes.push(part.episodes);
        self.claimed.push(part.claimed);
        self.lost.push(part.failed + part.expired);
        self.success.push(over(part.successes as f64, part.episodes));
        self.score.push(over(part.score, part.episodes));
        self.skill.push(over(part.skill, part.skilled));
        self.contested.push(over(part.solved, part.contested));
        self.contested_n.push(part.contested);
        self.panel.push(over(part.panel, part.panels));
        self.zero_variance.push(over(part.flat as f64, part.groups));
        self.low.push(part.low);
        self.high.push(part.high);
        self.level.push(standing.and_then(|at| at.level));
        self.mastery.push(standing.map(|at| at.mean));
        self.mastery_low.push(standing.map(|at| at.q10));
        self.mastery_high.push(standing.map(|at| at.q90));
        self.push_params(part);
    }

    /// Every param has a value or none at every point, those that appear late too.
    fn push_params(&mut self, part: &HistoryBucket) {
        let before = self.at.len() - 1;
        for name in part.params.keys() {
            self.params.entry(name.clone()).or_insert_with(|| ParamSeries {
                mean: vec![None; before],
                low: vec![None; before],
                high: vec![None; before],
            });
        }
        for (name, series) in &mut self.params {
            let spread = part.params.get(name);
            series.mean.push(spread.map(|spread| spread.total / spread.n.max(1) as f64));
            series.low.push(spread.map(|spread| spread.low));
            series.high.push(spread.map(|spread| spread.high));
        }
    }
}

/// Stretches in which nothing came have a point at their beginning and at their end: a line between what came before and after would claim
/// what was not.
fn by_task(points: Vec<HistoryPoint>, width: Millis) -> Vec<TaskSeries> {
    let mut tasks = Vec::<TaskSeries>::new();
    for HistoryPoint { task, start, bucket } in points {
        if tasks.last().is_none_or(|last| last.task != task) {
            tasks.push(TaskSeries { task, ..TaskSeries::default() });
        }
        if let Some(last) = tasks.last_mut() {
            let quiet = last.at.last().map(|at| (at * 1000 + width, start - width));
            if let Some((begun, ended)) = quiet.filter(|(begun, ended)| begun <= ended) {
                last.push(begun, &HistoryBucket::default());
                if begun < ended {
                    last.push(ended, &HistoryBucket::default());
                }
            }
            last.push(start, &bucket);
        }
    }
    tasks
}

fn moment(field: &'static str, text: Option<&String>, unless_told: Millis) -> Result<Millis, Problem> {
    let Some(text) = text else { return Ok(unless_told) };
    let read = text.parse::<jiff::Timestamp>();
    let moment =
        read.map_err(|_| Problem::invalid(field, "must be a moment as 2026-01-31T12:00:00Z".to_owned()))?;
    Ok(moment.as_millisecond())
}

/// Show how a run went over time: success, skill, mastery, levels and params, task by task. Points are buckets of time in which something
/// came back. Of the last week they are as short as a minute, of before an hour.
#[utoipa::path(
    get, path = "/runs/{run}/series", tag = "mastery",
    params(("run" = String, Path, description = "The run's id."), Which),
    responses(
        (status = 200, body = Series), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn show(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(which): Query<Which>,
) -> Result<axum::Json<Series>, Problem> {
    let run = run_id(&run)?;
    let mut conn = reader_of(&app, &run).await?;
    let now = app.clock.now();
    let begun = runs::get(&mut conn, run.as_str()).await?.map_or(now, |row| row.created_at);
    let (from, to) = (moment("from", which.from.as_ref(), begun)?, moment("to", which.to.as_ref(), now)?);
    if to < from {
        return Err(Problem::invalid("to", "lies before `from`".to_owned()));
    }
    let points = which.points.unwrap_or(POINTS);
    if !(1..=MOST).contains(&points) {
        return Err(Problem::invalid("points", format!("is {points}, but must be from 1 to {MOST}")));
    }
    let window = HistoryWindow::new(from, to, i64::from(points), now);
    let mut points = history::curve(&mut conn, run.as_str(), window).await?;
    if to >= now {
        update_last_points(&mut points, &app.writer.query(CurrentStanding { run }).await?);
    }
    let tasks = by_task(points, window.width);
    Ok(axum::Json(Series {
        from: rfc3339(window.from),
        to: rfc3339(window.to),
        width_s: window.width / 1000,
        tasks,
    }))
}
