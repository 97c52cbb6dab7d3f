//! List of the failures behind a profile.

use api_types::{EpisodeFailure, FailurePage, FailureQuery};
use axum::extract::State;
use env_core::TaskSpec;
use env_core::critique::BEARING_SECTORS;

use super::super::extract::{Path, Query};
use super::super::problem::Problem;
use super::failures::tasks_of;
use super::{Cursor, next_cursor, page_limit, run_id};
use crate::http::state::AppState;
use crate::ids::{EpisodeId, LeaseId};
use crate::store::failures::{self, FailureCursor, FailureFilter, ListedFailure};

/// List the failures behind a profile, newest first: those of a task, or of one of its modes, sectors, bands or cells.
#[utoipa::path(
    get, path = "/runs/{run}/failures/list", tag = "failures",
    params(("run" = String, Path, description = "The run's id."), FailureQuery),
    responses(
        (status = 200, body = FailurePage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list_failures(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<FailureQuery>,
) -> Result<axum::Json<FailurePage>, Problem> {
    let run = run_id(&run)?;
    let FailureQuery { task, mode, sector, band, limit, cursor } = query;
    let (limit, before) = (page_limit(limit)?, failure_before(cursor.as_deref())?);
    let mut conn = app.readers.acquire().await?;
    let filter = FailureFilter { mode, sector, band, before };
    for spec in tasks_of(&mut conn, &run, Some(&task)).await? {
        check_filter(spec, &filter)?;
    }
    let kept = failures::examples(&mut conn, run.as_str(), &task, &filter, limit).await?;
    let last = kept.last().map(|k| (k.example.place, format!("{}-{}", k.cell, k.example.nth)));
    let next = next_cursor(kept.len(), limit, last.as_ref().map(|(place, rest)| (*place, rest.as_str())));
    Ok(axum::Json(FailurePage { failures: kept.into_iter().map(episode_failure).collect(), next }))
}

/// Checks that the task has the mode, sector and band of a filter.
fn check_filter(task: &dyn TaskSpec, filter: &FailureFilter) -> Result<(), Problem> {
    if let Some(mode) = &filter.mode
        && !task.failure_modes().iter().any(|spec| spec.name == mode)
    {
        let known: Vec<_> = task.failure_modes().iter().map(|spec| spec.name).collect();
        return Err(Problem::invalid(
            "mode",
            format!("the task has no such failure mode; choose one of {}", known.join(", ")),
        ));
    }
    let within = |field: &str, number: Option<u32>, last: u32| match number.filter(|number| *number > last) {
        Some(number) => Err(Problem::invalid(field, format!("it is {number}, outside 0 to {last}"))),
        None => Ok(()),
    };
    within("sector", filter.sector, BEARING_SECTORS - 1)?;
    within("band", filter.band, task.speed_bands().edges.len() as u32)
}

/// Failure before which a page starts. The cursor is `place.cell-nth`.
fn failure_before(cursor: Option<&str>) -> Result<Option<FailureCursor>, Problem> {
    let Some(Cursor { number: place, text }) = Cursor::parse(cursor)? else { return Ok(None) };
    let key = text.split_once('-').and_then(|(cell, nth)| Some((cell.parse().ok()?, nth.parse().ok()?)));
    let (cell, nth) =
        key.ok_or_else(|| Problem::invalid("cursor", "it is not a cursor that a list returned"))?;
    Ok(Some(FailureCursor { place, cell, nth }))
}

fn episode_failure(listed: ListedFailure) -> EpisodeFailure {
    let ListedFailure { key, token, example, .. } = listed;
    let lease = LeaseId { number: example.lease, token };
    EpisodeFailure {
        episode: EpisodeId { lease, index: example.number }.to_string(),
        mode: key.mode,
        agent: example.agent,
        step: example.step,
        sector: key.encounter.map(|bin| bin.sector),
        band: key.encounter.map(|bin| bin.band),
        bearing_deg: example.bearing_deg,
        relative_speed: example.relative_speed,
        steps_left: example.steps_left,
        avoidable: example.avoidable,
    }
}
