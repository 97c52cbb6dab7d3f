//! Request to a designer through the API.

use api_types::{CreateDesignRequest, DesignRequestSummary};
use axum::extract::State;
use axum::http::{HeaderName, StatusCode, header};
use jobs::JobKind;
use store::ids::DesignRequestId;

use super::view::request_summary;
use crate::designs::request_design::RequestDesign;
use crate::http::extract::{Json, NoQuery, Path};
use crate::http::path_ids::parse_run_id;
use crate::http::problem::Problem;
use crate::http::state::AppState;

/// Create a design request: a designer makes layouts that aim at the agent's failures.
///
/// The server responds at once and runs the designer in the background; the `state` of the request shows its progress.
#[utoipa::path(
    post, path = "/runs/{run}/designs", tag = "designs", request_body = CreateDesignRequest,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 202, body = DesignRequestSummary, description = "The request was accepted; `Location` is its path.", headers(("location" = String))),
        (status = 400, body = Problem), (status = 404, body = Problem), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem), (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn create_design_request(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(request): Json<CreateDesignRequest>,
) -> Result<(StatusCode, [(HeaderName, String); 1], axum::Json<DesignRequestSummary>), Problem> {
    let run = parse_run_id(&run)?;
    let CreateDesignRequest { task, count, designer } = request;
    let has_llm =
        app.designers.has_llm() || app.lease_service.audits.queue.status().is_served(JobKind::DesignLlm);
    let change = RequestDesign { run: run.clone(), task, count, designer, has_llm };
    let row = app.writer.change(change).await?;
    let location = format!("/v1/runs/{run}/designs/requests/{}", DesignRequestId(row.id));
    Ok((StatusCode::ACCEPTED, [(header::LOCATION, location)], axum::Json(request_summary(row)?)))
}
