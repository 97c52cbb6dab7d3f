//! The failures behind a profile, one by one.

use axum::extract::State;
use env_core::TaskSpec;
use env_core::critique::BEARING_SECTORS;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::super::extract::{Path, Query};
use super::super::problem::Problem;
use super::failures::tasks_of;
use super::{Page, next, run_id};
use crate::ids::{EpisodeId, LeaseId};
use crate::http::state::AppState;
use crate::store::failures::{self, FailureCursor, FailureFilter, ListedFailure};

/// Which failures are listed.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(super) struct Listed {
    /// Of this task.
    task: String,
    /// Of this failure mode.
    mode: Option<String>,
    /// Of this bearing sector, 0 to 11.
    sector: Option<u32>,
    /// Of this speed band.
    band: Option<u32>,
    /// How many at most: 1 to 500 (50).
    limit: Option<u32>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// A page of failures.
#[derive(Serialize, ToSchema)]
pub(super) struct Failures {
    /// The newest first; of each cell of the profile the last 64 are kept.
    failures: Vec<FailureHead>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// One failure.
#[derive(Serialize, ToSchema)]
struct FailureHead {
    /// The episode.
    episode: String,
    /// The failure mode.
    mode: String,
    /// Whose.
    agent: i64,
    /// When, counted from 1.
    step: i64,
    /// The bearing sector; none where nothing was met.
    sector: Option<u32>,
    /// The speed band; none where nothing was met.
    band: Option<u32>,
    /// Degrees from radial out towards in-track.
    bearing_deg: Option<f64>,
    /// In the world's unit of speed.
    relative_speed: Option<f64>,
    /// Steps that were left to act.
    steps_left: Option<i64>,
    /// Whether acting then would have avoided it; none if nothing was met, or it was never visible.
    avoidable: Option<bool>,
}

impl FailureHead {
    fn of(kept: ListedFailure) -> Self {
        let ListedFailure { key, token, example: x, .. } = kept;
        let lease = LeaseId { number: x.lease, token };
        Self {
            episode: EpisodeId { lease, index: x.number }.to_string(),
            mode: key.mode,
            agent: x.agent,
            step: x.step,
            sector: key.encounter.map(|bin| bin.sector),
            band: key.encounter.map(|bin| bin.band),
            bearing_deg: x.bearing_deg,
            relative_speed: x.relative_speed,
            steps_left: x.steps_left,
            avoidable: x.avoidable,
        }
    }
}

/// List the failures behind a profile, the newest first: the episodes that a cell, a sector, a mode or a whole task is
/// made of.
#[utoipa::path(
    get, path = "/runs/{run}/failures/list", tag = "failures",
    params(("run" = String, Path, description = "The run's id."), Listed),
    responses(
        (status = 200, body = Failures), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(listed): Query<Listed>,
) -> Result<axum::Json<Failures>, Problem> {
    let run = run_id(&run)?;
    let Listed { task, mode, sector, band, limit, cursor } = listed;
    let page = Page { limit, cursor };
    let (limit, before) = (page.limit()?, before(&page)?);
    let mut conn = app.readers.acquire().await?;
    let wanted = FailureFilter { mode, sector, band, before };
    for spec in tasks_of(&mut conn, &run, Some(&task)).await? {
        check(spec, &wanted)?;
    }
    let kept = failures::examples(&mut conn, run.as_str(), &task, &wanted, limit).await?;
    let last = kept.last().map(|k| (k.example.place, format!("{}-{}", k.cell, k.example.nth)));
    let next = next(kept.len(), limit, last.as_ref().map(|(place, rest)| (*place, rest.as_str())));
    Ok(axum::Json(Failures { failures: kept.into_iter().map(FailureHead::of).collect(), next }))
}

/// Whether the task has such a mode, sector and band.
fn check(task: &dyn TaskSpec, wanted: &FailureFilter) -> Result<(), Problem> {
    if let Some(mode) = &wanted.mode
        && !task.failure_modes().iter().any(|spec| spec.name == mode)
    {
        let known: Vec<_> = task.failure_modes().iter().map(|spec| spec.name).collect();
        return Err(Problem::invalid(
            "mode",
            format!("the task has no such mode; it has {}", known.join(", ")),
        ));
    }
    let within = |field: &str, number: Option<u32>, last: u32| match number.filter(|number| *number > last) {
        Some(number) => Err(Problem::invalid(field, format!("it is {number}, outside 0 to {last}"))),
        None => Ok(()),
    };
    within("sector", wanted.sector, BEARING_SECTORS - 1)?;
    within("band", wanted.band, task.speed_bands().edges.len() as u32)
}

fn before(page: &Page) -> Result<Option<FailureCursor>, Problem> {
    if page.cursor.is_none() {
        return Ok(None);
    }
    let (place, rest) = page.cursor()?;
    let rest = rest.split_once('-').and_then(|(cell, nth)| Some((cell.parse().ok()?, nth.parse().ok()?)));
    let (cell, nth) = rest.ok_or_else(|| Problem::invalid("cursor", "it is not one that a list gave"))?;
    Ok(Some(FailureCursor { place, cell, nth }))
}
