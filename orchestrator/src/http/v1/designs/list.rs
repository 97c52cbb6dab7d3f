//! The designs of a run, one by one.

use axum::extract::State;
use serde::Deserialize;
use utoipa::IntoParams;

use super::super::super::extract::{Path, Query};
use super::super::super::problem::Problem;
use super::super::failures::tasks_of;
use super::super::{Page, id, run_id};
use super::view::{Designs, before, known_mode, word_of};
use crate::ids::DesignRequestId;
use crate::http::state::AppState;
use crate::store::layouts::{self, LayoutFilter, LayoutState};

/// Which designs are listed.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::http::v1) struct Listed {
    /// Of this task.
    task: Option<String>,
    /// In this state: `active`, `retired` or `refused`.
    state: Option<String>,
    /// That go for this failure mode.
    mode: Option<String>,
    /// Of this ask.
    ask: Option<String>,
    /// How many at most: 1 to 500 (50).
    limit: Option<u32>,
    /// `next` of the page before.
    cursor: Option<String>,
}

/// List what designers thought of for a run, the newest first: layouts that serve or served, and what the gate refused (at
/// most 64 of an ask are kept; all are counted in its answer and in the summary).
#[utoipa::path(
    get, path = "/runs/{run}/designs", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), Listed),
    responses(
        (status = 200, body = Designs), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn list(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(listed): Query<Listed>,
) -> Result<axum::Json<Designs>, Problem> {
    let run = run_id(&run)?;
    let Listed { task, state, mode, ask, limit, cursor } = listed;
    let state = word_of("state", state.as_deref(), LayoutState::ALL)?;
    let ask = ask.map(|ask| id::<DesignRequestId>("ask", &ask)).transpose()?;
    let page = Page { limit, cursor };
    let (limit, before) = (page.limit()?, before(&page)?);
    let mut conn = app.readers.acquire().await?;
    let tasks = tasks_of(&mut conn, &run, task.as_deref()).await?;
    known_mode("mode", mode.as_ref(), &tasks)?;
    let wanted = LayoutFilter { task, state, mode, request: ask.map(|ask| ask.0), with_refused: true };
    let rows = layouts::of_run(&mut conn, run.as_str(), &wanted, before, limit).await?;
    Ok(axum::Json(Designs::of(&rows, limit)?))
}
