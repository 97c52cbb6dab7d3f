//! Samplers of a run's tasks, with the course of their draws.

use std::collections::BTreeMap;

use api_types::{RunSampler, SamplerRung, SeriesQuery, TaskSampler};
use axum::extract::State;
use curriculum::{RungKind, RungState, SamplerState};
use store::history::{HistoryBucket, RungResults};

use super::run_points::{CurrentPoints, read_run_points};
use crate::api_enums::ConvertEnum;
use crate::http::extract::{Path, Query};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::acquire_run_reader;
use crate::http::state::AppState;
use crate::queries::run_series::{SeriesContent, SeriesPoint};
use crate::queries::samplers::{RunSamplers, SamplersQuery};
use clock::rfc3339;

/// A point of the course, with its results by rung.
type CoursePoint<'a> = (&'a SeriesPoint, BTreeMap<u32, RungResults>);

/// Get the sampler of each task of a run: the rungs it draws, the success there, and the course of both.
///
/// Points of the course are those of the run's series.
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
    let CurrentPoints { points, .. } =
        read_run_points(&mut conn, &run, &query, SeriesContent::Rungs, app.clock.now()).await?;
    let RunSamplers { strategy, tasks } = app.writer.query(SamplersQuery { run }).await?;
    let of_task = |task: &str| points.tasks.get(task).map_or(&[][..], Vec::as_slice);
    Ok(axum::Json(RunSampler {
        strategy: strategy.to_string(),
        from: rfc3339(points.from),
        to: rfc3339(points.to),
        resolution: points.resolution.convert(),
        tasks: tasks
            .into_iter()
            .map(|sampler| {
                let points = of_task(&sampler.task);
                task_sampler(sampler, points)
            })
            .collect(),
    }))
}

fn task_sampler(sampler: SamplerState, points: &[SeriesPoint]) -> TaskSampler {
    let course: Vec<CoursePoint<'_>> = sampler.kind.map_or_else(Vec::new, |kind| course_of(kind, points));
    let rungs = sampler.rungs.iter().map(|rung| sampler_rung(rung, sampler.proposals, &course)).collect();
    let SamplerState { task, name, reason, state, kind, proposals, quartiles, .. } = sampler;
    let points = || course.iter().map(|(point, _)| *point);
    TaskSampler {
        task,
        name,
        reason,
        state,
        kind: kind.map(ConvertEnum::convert),
        proposals,
        quartiles,
        at: points().map(|point| point.from as f64 / 1000.0).collect(),
        until: points().map(|point| point.to as f64 / 1000.0).collect(),
        first_episode: points().map(|point| point.position.map(|at| at.first_episode)).collect(),
        first_step: points().map(|point| point.position.map(|at| at.first_step)).collect(),
        episodes: points().map(|point| point.bucket.episodes + point.bucket.claimed_episodes).collect(),
        steps: points().map(|point| point.position.map(|_| point.bucket.steps)).collect(),
        version_high: points().map(|point| point.bucket.versions.map(|versions| versions.high)).collect(),
        rungs,
    }
}

/// Points with results at the rungs of a kind.
fn course_of(kind: RungKind, points: &[SeriesPoint]) -> Vec<CoursePoint<'_>> {
    let with_rungs = points.iter().map(|point| (point, results_by_rung(kind, &point.bucket)));
    with_rungs.filter(|(_, rungs)| !rungs.is_empty()).collect()
}

/// Results of a point by the rungs of a kind.
fn results_by_rung(kind: RungKind, bucket: &HistoryBucket) -> BTreeMap<u32, RungResults> {
    let mut rungs: BTreeMap<u32, RungResults> = BTreeMap::new();
    for (key, results) in &bucket.rungs {
        let rung = match kind {
            RungKind::Start => key.start_rung,
            RungKind::Level => key.level,
        };
        if let Some(rung) = rung.and_then(|rung| u32::try_from(rung).ok()) {
            rungs.entry(rung).or_default().join(*results);
        }
    }
    rungs
}

fn sampler_rung(state: &RungState, proposals: u32, course: &[CoursePoint<'_>]) -> SamplerRung {
    let RungState { rung, start_scale, probability, chains, successes, attempts, draws } = *state;
    let results: Vec<RungResults> =
        course.iter().map(|(_, rungs)| rungs.get(&rung).copied().unwrap_or_default()).collect();
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
