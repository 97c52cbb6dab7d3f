//! List of a run's designs.

use api_types::{DesignPage, DesignQuery};
use axum::extract::State;
use store::ids::DesignRequestId;
use store::layouts::{self, LayoutFilter, LayoutState};

use super::view::design_page;
use crate::http::extract::{Path, Query};
use crate::http::filters::{check_failure_mode, parse_filter_word};
use crate::http::paging::{number_before, page_limit};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::run_reader::find_run_tasks;
use crate::http::state::AppState;

/// List the designs of a run, newest first: active and retired layouts, and designs that the gate refused.
///
/// At most 64 refused designs of a request are kept; the request and the statistics count all of them.
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
    let run = parse_run_id(&run)?;
    let DesignQuery { task, state, mode, request, limit, cursor } = query;
    let state = parse_filter_word("state", state.as_deref(), LayoutState::ALL)?;
    let request = request.map(|request| parse_id::<DesignRequestId>("request", &request)).transpose()?;
    let (limit, before) = (page_limit(limit)?, number_before(cursor.as_deref())?);
    let mut conn = app.readers.acquire().await?;
    let tasks = find_run_tasks(&mut conn, &run, task.as_deref()).await?;
    check_failure_mode("mode", mode.as_ref(), &tasks)?;
    let filter =
        LayoutFilter { task, state, mode, request: request.map(|request| request.0), with_refused: true };
    let rows = layouts::of_run(&mut conn, run.as_str(), &filter, before, limit).await?;
    Ok(axum::Json(design_page(&rows, limit)?))
}
