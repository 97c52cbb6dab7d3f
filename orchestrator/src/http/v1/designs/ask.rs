//! Asking a designer by hand.

use axum::extract::State;
use axum::http::{HeaderName, StatusCode, header};
use serde::Deserialize;
use utoipa::ToSchema;

use super::super::super::extract::{Json, NoQuery, Path};
use super::super::super::problem::Problem;
use super::super::run_id;
use super::asks::AskView;
use crate::ids::DesignRequestId;
use crate::http::state::AppState;
use crate::designs::DesignerChoice;
use crate::designs::manual::RequestDesign;

/// What is asked. Everything may be left out.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub(in crate::http::v1) struct DesignAsk {
    /// For which of the run's tasks (the one whose failures weigh most).
    task: Option<String>,
    /// How many layouts: 1 to 32 (the run's stock).
    n: Option<u32>,
    /// Who is asked: `auto`, `llm` or `procedural` (who designs for the run).
    designer: Option<DesignerChoice>,
}

/// Ask a designer for layouts that go for what the agent fails at. It is answered at once, and done behind everything else:
/// the ask's `state` says how far it is.
#[utoipa::path(
    post, path = "/runs/{run}/designs", tag = "designs", request_body = DesignAsk,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 202, body = AskView, description = "Asked; `Location` is the ask.", headers(("location" = String))),
        (status = 400, body = Problem), (status = 404, body = Problem), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem), (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn ask(
    _: NoQuery,
    State(app): State<AppState>,
    Path(run): Path<String>,
    Json(wish): Json<DesignAsk>,
) -> Result<(StatusCode, [(HeaderName, String); 1], axum::Json<AskView>), Problem> {
    let run = run_id(&run)?;
    let DesignAsk { task, n, designer } = wish;
    let change = RequestDesign { run: run.clone(), task, n, designer, has_llm: app.designers.has_llm() };
    let row = app.writer.change(change).await?;
    let location = format!("/v1/runs/{run}/designs/asks/{}", DesignRequestId(row.id));
    Ok((StatusCode::ACCEPTED, [(header::LOCATION, location)], axum::Json(AskView::of(row)?)))
}
