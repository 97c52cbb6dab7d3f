//! Creation of an evaluation.

use api_types::{EvaluationRequest, EvaluationSummary};
use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use store::shard::Shard;

use super::view::evaluation_summary;
use crate::evaluations::begin::BeginEvaluation;
use crate::http::access::Caller;
use crate::http::extract::{Json, NoQuery};
use crate::http::problem::Problem;
use crate::http::shard_routing::{ForwardedRequest, forward};
use crate::http::state::AppState;
use crate::ownership::{self, RunPermission};

/// Create an evaluation on a frozen suite.
///
/// Without `run` the server rolls out a built-in policy, or a file in its policy folder (`onnx:FILE`, `reflex:FILE`). With `run` the trainer of the run leases the scenarios (`purpose: eval`,
/// `evaluation`: this id) and reports results until no scenario is left. Only the owner of the run or an admin can create such an
/// evaluation. Evaluation seeds are never used for training. The server passes a request for a run of a peer's shard on.
#[utoipa::path(
    post, path = "/evaluations", tag = "evaluations", request_body = EvaluationRequest,
    responses(
        (status = 201, body = EvaluationSummary), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn create_evaluation(
    _: NoQuery,
    State(app): State<AppState>,
    Extension(caller): Extension<Caller>,
    headers: HeaderMap,
    Json(request): Json<EvaluationRequest>,
) -> Result<(StatusCode, axum::Json<EvaluationSummary>), Problem> {
    let shard = request.run.as_deref().and_then(Shard::of_id);
    let forwarded = ForwardedRequest::post("/v1/evaluations", &request);
    if let Some(evaluation) = forward(&app, &headers, shard.as_ref(), forwarded).await? {
        return Ok((StatusCode::CREATED, axum::Json(evaluation)));
    }
    // A suite is read on first use, which takes too long for a thread of the runtime.
    let folder = app.policy_folder.clone();
    let parsed = tokio::task::spawn_blocking(move || BeginEvaluation::from_request(request, &folder)).await;
    let change = parsed.map_err(|error| Problem::invalid("suite", error.to_string()))??;
    if let Some(run) = change.run() {
        let mut conn = app.readers.acquire().await?;
        ownership::check_run(&mut conn, caller.actor(), run, RunPermission::Change).await?;
    }
    let row = app.writer.change(change.owned_by(caller.actor().principal())).await?;
    tracing::info!(evaluation = row.id, suite = row.suite, policy = row.policy, "Evaluation created.");
    Ok((StatusCode::CREATED, axum::Json(evaluation_summary(row, app.shards.own()))))
}
