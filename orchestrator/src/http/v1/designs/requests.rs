//! Requests to designers: list and get.

use api_types::{DesignRequest, DesignRequestPage, DesignRequestQuery};
use axum::extract::State;
use store::design_requests::{self, RequestFilter, RequestState};
use store::from_json;
use store::ids::DesignRequestId;

use super::view::request_summary;
use crate::engine::error::ServiceError;
use crate::http::extract::{NoQuery, Path, Query};
use crate::http::filters::parse_filter_word;
use crate::http::paging::{PageCursor, next_cursor, number_before, page_limit};
use crate::http::path_ids::{parse_id, parse_run_id};
use crate::http::problem::Problem;
use crate::http::run_reader::{acquire_run_reader, find_run_tasks};
use crate::http::state::AppState;

/// List the design requests of a run, newest first.
#[utoipa::path(
    get, path = "/runs/{run}/designs/requests", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), DesignRequestQuery),
    responses(
        (status = 200, body = DesignRequestPage), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn list_design_requests(
    State(app): State<AppState>,
    Path(run): Path<String>,
    Query(query): Query<DesignRequestQuery>,
) -> Result<axum::Json<DesignRequestPage>, Problem> {
    let run = parse_run_id(&run)?;
    let DesignRequestQuery { task, state, limit, cursor } = query;
    let state: Option<RequestState> = parse_filter_word("state", state.as_deref(), RequestState::ALL)?;
    let (limit, before) = (page_limit(limit)?, number_before(cursor.as_deref())?);
    let mut conn = app.readers.acquire().await?;
    find_run_tasks(&mut conn, &run, task.as_deref()).await?;
    let filter = RequestFilter { task: task.as_deref(), state };
    let rows = design_requests::page(&mut conn, run.as_str(), filter, before, limit).await?;
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.id)));
    Ok(axum::Json(DesignRequestPage {
        requests: rows.into_iter().map(request_summary).collect::<Result<_, _>>()?,
        next,
    }))
}

/// Get a design request with the failure profile that it is based on.
#[utoipa::path(
    get, path = "/runs/{run}/designs/requests/{request}", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), ("request" = String, Path, description = "Id of the design request.")),
    responses((status = 200, body = DesignRequest), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(in crate::http::v1) async fn get_design_request(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, request)): Path<(String, String)>,
) -> Result<axum::Json<DesignRequest>, Problem> {
    let (run, request) = (parse_run_id(&run)?, parse_id::<DesignRequestId>("request", &request)?);
    let mut conn = acquire_run_reader(&app, &run).await?;
    let row = design_requests::get(&mut conn, run.as_str(), request.0).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownDesignRequest(request.to_string()))?;
    let profile = row.profile.as_deref().map(|text| from_json("a failure profile", text)).transpose()?;
    Ok(axum::Json(DesignRequest { profile, summary: request_summary(row)? }))
}
