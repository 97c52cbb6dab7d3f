//! Rollout of a scenario with the actions so far, for manual play.

use api_types::{Rollout, RolloutRequest};
use axum::extract::State;
use env_core::Scenario;
use env_core::error::ReplayError;
use env_core::log::Precision;
use env_core::rollout::read_log;
use serde_json::Value;

use super::scenarios::{replay_problem, user_scenario};
use crate::http::extract::{Json, NoQuery, parse_value};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use env_core::frames::{FrameContent, FrameRange, MAX_FRAME_BYTES, frames};

/// Roll out a scenario to the end of its steps, to the step `until`, or to the end of the episode.
///
/// The server stores nothing and computes no bracket; `POST /v1/scenarios` evaluates the result.
#[utoipa::path(
    post, path = "/rollouts", tag = "scenarios", request_body = RolloutRequest,
    responses(
        (status = 200, body = Rollout), (status = 400, body = Problem), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn roll_out_scenario(
    _: NoQuery,
    State(app): State<AppState>,
    Json(body): Json<Value>,
) -> Result<axum::Json<Rollout>, Problem> {
    let RolloutRequest { scenario, steps, until, from } = parse_value(body)?;
    let scenario = user_scenario(&scenario)?;
    let rollout = app.concurrency.rollouts.run(move |_| roll_out(&scenario, &steps, from, until)).await?;
    Ok(axum::Json(rollout?))
}

fn roll_out(scenario: &Scenario, steps: &[Value], from: u32, until: u32) -> Result<Rollout, Problem> {
    let task = scenario.task();
    let log =
        read_log(scenario, steps, Precision::F64, None).map_err(|error| replay_problem("", error.into()))?;
    let last = u32::try_from(steps.len()).unwrap_or(u32::MAX).max(until);
    if from > last {
        return Err(Problem::invalid(
            "from",
            format!("must be at most {last}, the last step of the rollout, got {from}"),
        ));
    }
    let range = FrameRange { first: from, last, max_bytes: MAX_FRAME_BYTES };
    let frames = frames(scenario, &log, FrameContent::Telemetry, range).map_err(|error| match error {
        env_core::frames::FramesError::Scenario(error) => replay_problem("", ReplayError::Scenario(error)),
        error => Problem::invalid("steps", error.to_string()),
    })?;
    let done = frames.last().is_some_and(|frame| frame["done"] == true);
    Ok(Rollout {
        scenario_id: scenario.id().to_string(),
        scenario: scenario.to_json(),
        done,
        horizon: task.horizon(scenario.recipe()),
        frames,
    })
}
