//! List of the failures behind a profile.

use api_types::{EpisodeFailure, FailurePage, FailureQuery};
use axum::extract::State;
use env_core::TaskSpec;
use env_core::critique::PROFILE_SECTORS;
use store::failures::{self, FailureCursor, FailureFilter, ListedFailure};
use store::ids::{EpisodeId, LeaseId};

use crate::http::extract::{Path, Query};
use crate::http::filters::check_failure_mode;
use crate::http::paging::{PageCursor, next_cursor, page_limit};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::run_reader::find_run_tasks;
use crate::http::state::AppState;

/// List the failures of a failure profile, newest first.
///
/// The query selects a task, and optionally one of its failure modes, sectors and speed bands.
#[utoipa::path(
    get, path = "/runs/{run}/failures", tag = "failures",
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
    let run = parse_run_id(&run)?;
    let FailureQuery { task, mode, sector, band, limit, cursor } = query;
    let (limit, before) = (page_limit(limit)?, failure_before(cursor.as_deref())?);
    let mut conn = app.readers.acquire().await?;
    let filter = FailureFilter { mode, sector, band, before };
    for spec in find_run_tasks(&mut conn, &run, Some(&task)).await? {
        check_filter(spec, &filter)?;
    }
    let kept = failures::examples(&mut conn, run.as_str(), &task, &filter, limit).await?;
    let key = kept.last().map(|failure| format!("{}-{}", failure.cell, failure.example.ordinal));
    let last = kept.last().zip(key.as_deref());
    let last = last.map(|(failure, text)| PageCursor { number: failure.example.episode_ordinal, text });
    let next = next_cursor(kept.len(), limit, last);
    Ok(axum::Json(FailurePage { failures: kept.into_iter().map(episode_failure).collect(), next }))
}

/// Checks that the task has the mode, sector and band of a filter.
fn check_filter(task: &'static dyn TaskSpec, filter: &FailureFilter) -> Result<(), Problem> {
    check_failure_mode("mode", filter.mode.as_ref(), &[task])?;
    let within = |field: &str, number: Option<u32>, last: u32| match number.filter(|number| *number > last) {
        Some(number) => Err(Problem::invalid(field, format!("must be from 0 to {last}, got {number}"))),
        None => Ok(()),
    };
    within("sector", filter.sector, PROFILE_SECTORS - 1)?;
    within("band", filter.band, task.speed_bands().edges.len() as u32)
}

/// Failure before which a page starts. The cursor is `episode_ordinal.cell-ordinal`.
fn failure_before(cursor: Option<&str>) -> Result<Option<FailureCursor>, Problem> {
    let Some(PageCursor { number: episode_ordinal, text }) = PageCursor::parse(cursor)? else {
        return Ok(None);
    };
    let key =
        text.split_once('-').and_then(|(cell, ordinal)| Some((cell.parse().ok()?, ordinal.parse().ok()?)));
    let (cell, ordinal) =
        key.ok_or_else(|| Problem::invalid("cursor", "must be the `next` of a previous page"))?;
    Ok(Some(FailureCursor { episode_ordinal, cell, ordinal }))
}

fn episode_failure(listed: ListedFailure) -> EpisodeFailure {
    let ListedFailure { key, id_suffix: suffix, example, .. } = listed;
    let lease = LeaseId { number: example.lease, suffix };
    EpisodeFailure {
        episode: EpisodeId { lease, index: example.number }.to_string(),
        mode: key.mode,
        agent: example.agent,
        step: example.step,
        sector: key.sector,
        band: key.band,
        sector_deg: example.sector_deg,
        relative_speed: example.relative_speed,
        steps_left: example.steps_left,
        avoidable: example.avoidable,
    }
}
