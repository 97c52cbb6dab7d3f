//! Requests to designers: list and get.

use api_types::{DesignRequest, DesignRequestPage, DesignRequestQuery, DesignRequestSummary};
use axum::extract::State;

use super::super::super::extract::{NoQuery, Path, Query};
use super::super::super::problem::Problem;
use super::super::failures::tasks_of;
use super::super::{next_cursor, number_before, page_limit, parse_id, reader_of_run, run_id};
use super::view::parse_filter_word;
use crate::clock::rfc3339;
use crate::engine::error::ServiceError;
use crate::http::state::AppState;
use crate::ids::DesignRequestId;
use crate::store::design_requests::{self, DesignRequestRow, RequestFilter, RequestState};
use crate::store::from_json;

/// Converts the row of a request.
///
/// # Errors
/// Returns an internal problem if its stored troubles cannot be read.
pub(super) fn request_summary(row: DesignRequestRow) -> Result<DesignRequestSummary, Problem> {
    Ok(DesignRequestSummary {
        id: DesignRequestId(row.id).to_string(),
        troubles: from_json("the troubles of a design request", &row.troubles)?,
        task: row.task,
        level: row.level,
        designer: row.designer.to_string(),
        asked_by: row.origin.to_string(),
        state: row.state.to_string(),
        wanted: row.wanted,
        admitted: row.admitted,
        refused: row.refused,
        model: row.model,
        prompt: row.prompt,
        rounds: row.rounds,
        tokens_in: row.tokens_in,
        tokens_out: row.tokens_out,
        cost: row.cost,
        latency_ms: row.latency_ms,
        criticised: row.criticised,
        error: row.error,
        created_at: rfc3339(row.created_at),
        ended_at: row.ended_at.map(rfc3339),
    })
}

/// List the requests to designers of a run, newest first.
#[utoipa::path(
    get, path = "/runs/{run}/designs/asks", tag = "designs",
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
    let run = run_id(&run)?;
    let DesignRequestQuery { task, state, limit, cursor } = query;
    let state: Option<RequestState> = parse_filter_word("state", state.as_deref(), RequestState::ALL)?;
    let (limit, before) = (page_limit(limit)?, number_before(cursor.as_deref())?);
    let mut conn = app.readers.acquire().await?;
    tasks_of(&mut conn, &run, task.as_deref()).await?;
    let filter = RequestFilter { task: task.as_deref(), state };
    let rows = design_requests::page(&mut conn, run.as_str(), filter, before, limit).await?;
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| (row.id, "")));
    Ok(axum::Json(DesignRequestPage {
        asks: rows.into_iter().map(request_summary).collect::<Result<_, _>>()?,
        next,
    }))
}

/// Get a request to a designer with the failure profile that it is based on.
#[utoipa::path(
    get, path = "/runs/{run}/designs/asks/{ask}", tag = "designs",
    params(("run" = String, Path, description = "The run's id."), ("ask" = String, Path, description = "Id of the design request.")),
    responses((status = 200, body = DesignRequest), (status = 400, body = Problem), (status = 404, body = Problem))
)]
pub(in crate::http::v1) async fn get_design_request(
    _: NoQuery,
    State(app): State<AppState>,
    Path((run, ask)): Path<(String, String)>,
) -> Result<axum::Json<DesignRequest>, Problem> {
    let (run, ask) = (run_id(&run)?, parse_id::<DesignRequestId>("ask", &ask)?);
    let mut conn = reader_of_run(&app, &run).await?;
    let row = design_requests::get(&mut conn, run.as_str(), ask.0).await?;
    let row = row.ok_or_else(|| ServiceError::UnknownAsk(ask.to_string()))?;
    let profile = row.profile.as_deref().map(|text| from_json("a failure profile", text)).transpose()?;
    Ok(axum::Json(DesignRequest { profile, summary: request_summary(row)? }))
}
