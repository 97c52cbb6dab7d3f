//! List of a run's designs.

use api_types::{DesignPage, DesignQuery};
use axum::extract::State;

use super::super::super::extract::{Path, Query};
use super::super::super::problem::Problem;
use super::super::failures::tasks_of;
use super::super::{number_before, page_limit, parse_id, run_id};
use super::view::{check_failure_mode, design_page, parse_filter_word};
use crate::http::state::AppState;
use crate::ids::DesignRequestId;
use crate::store::layouts::{self, LayoutFilter, LayoutState};

/// List the designs of a run, newest first: active and retired layouts, and designs that the gate refused. At most 64 refused designs of
/// a request are kept; the request and the statistics count all of them.
#[utoipa::path(
    get, path = "/runs/{run}/designs", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), DesignQuery),
    responses(
        (status = 200, body = DesignPage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn list_designs(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<DesignQuery>,
) -> Result<axum::Json<DesignPage>, Problem> {
    let run = run_id(&run)?;
    let DesignQuery { task, state, mode, ask, limit, cursor } = query;
    let state = parse_filter_word("state", state.as_deref(), LayoutState::ALL)?;
    let ask = ask.map(|ask| parse_id::<DesignRequestId>("ask", &ask)).transpose()?;
    let (limit, before) = (page_limit(limit)?, number_before(cursor.as_deref())?);
    let mut conn = app.readers.acquire().await?;
    let tasks = tasks_of(&mut conn, &run, task.as_deref()).await?;
    check_failure_mode("mode", mode.as_ref(), &tasks)?;
    let filter = LayoutFilter { task, state, mode, request: ask.map(|ask| ask.0), with_refused: true };
    let rows = layouts::of_run(&mut conn, run.as_str(), &filter, before, limit).await?;
    Ok(axum::Json(design_page(&rows, limit)?))
}
