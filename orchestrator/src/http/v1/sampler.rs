//! Samplers of a run's tasks, with the course of their draws.

use std::collections::BTreeMap;

use api_types::{RunSampler, SamplerRung, SeriesQuery, TaskSampler};
use axum::extract::State;
use curriculum::{RungKind, RungState, SamplerState};
use store::history::{self, HistoryWindow, RungPoint, RungResults};

use super::time_window::{TimeWindow, read_points};
use crate::api_enums::ConvertEnum;
use crate::http::extract::{Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::queries::samplers::{RunSamplers, SamplersQuery};
use clock::{Millis, rfc3339};

/// Results by start of the point and by rung.
type ResultsByPoint = BTreeMap<Millis, BTreeMap<u32, RungResults>>;

/// Get the sampler of each task of a run: the rungs it draws, the success there, and the course of both.
///
/// A point of the course covers an interval with results, of at least one minute in the last week and one hour before.
#[utoipa::path(
    get, path = "/runs/{run}/sampler", tag = "mastery",
    params(("run" = String, Path, description = "The run's id."), SeriesQuery),
    responses(
        (status = 200, body = RunSampler), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem), (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn get_sampler(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<SeriesQuery>,
) -> Result<axum::Json<RunSampler>, Problem> {
    let run = parse_run_id(&run)?;
    let mut conn = acquire_run_reader(&app, &run).await?;
    let now = app.clock.now();
    let TimeWindow { from, to } =
        TimeWindow::read(&mut conn, &run, query.from.as_ref(), query.to.as_ref(), now).await?;
    let window = HistoryWindow::new(from, to, i64::from(read_points(query.points)?), now);
    let points = history::rung_points(&mut conn, run.as_str(), window).await?;
    let RunSamplers { strategy, tasks } = app.writer.query(SamplersQuery { run }).await?;
    Ok(axum::Json(RunSampler {
        strategy: strategy.to_string(),
        from: rfc3339(window.from),
        to: rfc3339(window.to),
        width_s: window.width / 1000,
        tasks: tasks.into_iter().map(|sampler| task_sampler(sampler, &points)).collect(),
    }))
}

fn task_sampler(sampler: SamplerState, points: &[RungPoint]) -> TaskSampler {
    let course = sampler.kind.map_or_else(BTreeMap::new, |kind| course_of(&sampler.task, kind, points));
    let rungs = sampler.rungs.iter().map(|rung| sampler_rung(rung, sampler.proposals, &course)).collect();
    let SamplerState { task, name, reason, state, kind, proposals, quartiles, .. } = sampler;
    let at = course.keys().map(|start| start.div_euclid(1000)).collect();
    let kind = kind.map(ConvertEnum::convert);
    TaskSampler { task, name, reason, state, kind, proposals, quartiles, at, rungs }
}

/// Results of a task in each point, by the rungs of a kind.
fn course_of(task: &str, kind: RungKind, points: &[RungPoint]) -> ResultsByPoint {
    let mut course = ResultsByPoint::new();
    for RungPoint { start, key, results, .. } in points.iter().filter(|point| point.task == task) {
        let rung = match kind {
            RungKind::Start => key.start_rung,
            RungKind::Level => key.level,
        };
        if let Some(rung) = rung.and_then(|rung| u32::try_from(rung).ok()) {
            course.entry(*start).or_default().entry(rung).or_default().join(*results);
        }
    }
    course
}

fn sampler_rung(state: &RungState, proposals: u32, course: &ResultsByPoint) -> SamplerRung {
    let RungState { rung, start_scale, probability, chains, successes, attempts, draws } = *state;
    let results: Vec<RungResults> =
        course.values().map(|rungs| rungs.get(&rung).copied().unwrap_or_default()).collect();
    let success = |of: &RungResults| (of.episodes > 0).then(|| of.successes as f64 / of.episodes as f64);
    SamplerRung {
        rung,
        start_scale,
        probability,
        chains,
        successes,
        attempts,
        success: (attempts > 0.0).then(|| successes / attempts),
        draws,
        share: (proposals > 0).then(|| f64::from(draws) / f64::from(proposals)),
        groups: results.iter().map(|of| of.groups).collect(),
        group_success: results.iter().map(success).collect(),
    }
}
