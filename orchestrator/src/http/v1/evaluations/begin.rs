//! Beginning an evaluation.

use axum::extract::State;
use axum::http::StatusCode;

use super::super::super::extract::{Json, NoQuery};
use super::super::super::problem::Problem;
use super::view::Evaluation;
use crate::http::state::AppState;
use crate::evaluation::begin::{BeginEvaluation, EvaluationWish};

/// Begin an evaluation on a frozen suite. Without `run` the server flies a built-in policy. With `run` its trainer flies: it leases
/// scenarios (`purpose: eval`, `evaluation`: this id) and reports results as ever, until none is left. What its seeds make is never
/// trained on.
#[utoipa::path(
    post, path = "/evaluations", tag = "evaluations", request_body = EvaluationWish,
    responses(
        (status = 201, body = Evaluation), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 408, body = Problem), (status = 413, body = Problem), (status = 415, body = Problem), (status = 422, body = Problem),
        (status = 429, body = Problem), (status = 503, body = Problem)
    )
)]
pub(in crate::http::v1) async fn begin(
    _: NoQuery,
    State(app): State<AppState>,
    Json(wish): Json<EvaluationWish>,
) -> Result<(StatusCode, axum::Json<Evaluation>), Problem> {
    // The first time a suite is named it is read, which takes a while.
    let reading = tokio::task::spawn_blocking(move || BeginEvaluation::read(wish)).await;
    let change = reading.map_err(|error| Problem::invalid("suite", error.to_string()))??;
    let row = app.writer.change(change).await?;
    tracing::info!(evaluation = row.id, suite = row.suite, policy = row.policy, "An evaluation was begun.");
    Ok((StatusCode::CREATED, axum::Json(row.into())))
}
