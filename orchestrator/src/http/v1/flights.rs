//! A scenario flown by hand, as far as it was flown: what play asks for.

use axum::extract::State;
use env_core::Scenario;
use env_core::log::Precision;
use env_core::error::ReplayError;
use env_core::rollout::read_log;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::super::extract::{Json, NoQuery, read};
use super::super::problem::Problem;
use super::scenarios::{by_user, refuse};
use crate::frames::{FrameContent, FrameRange, MAX_FRAME_BYTES, frames};
use crate::http::state::AppState;

/// A scenario and what was done on it so far.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(example = json!({
    "scenario": {"task": "kessler/survival", "params": {"debris": 30}, "seed": 7}, "steps": [[[0, 0.1, 0.0]], []]
}))]
pub(super) struct FlightWish {
    /// The scenario, as in `POST /v1/scenarios`.
    #[schema(value_type = Object)]
    scenario: Value,
    /// One entry a step that was flown, the first step's first: a list of `[agent, value, …]` (none).
    #[serde(default)]
    #[schema(value_type = Vec<Vec<Vec<Value>>>)]
    steps: Vec<Value>,
    /// How far it is flown past them, with nobody acting: a step (where the steps end).
    #[serde(default)]
    until: u32,
    /// The first step whose frame is wanted (0).
    #[serde(default)]
    from: u32,
}

/// How far it came.
#[derive(Serialize, ToSchema)]
pub(super) struct Flight {
    /// The scenario's id.
    scenario_id: String,
    /// The scenario, complete.
    #[schema(value_type = Object)]
    scenario: Value,
    /// Whether the episode is over.
    done: bool,
    /// Steps after which it is cut off.
    horizon: u32,
    /// Frames from `from` on, the last one of the step that it came to; that one alone where it was over before `from`: `step`, `actions`, `reward`, `done`, `state` (the
    /// truth) and `observation` (what the agents saw).
    #[schema(value_type = Vec<Object>)]
    frames: Vec<Value>,
}

/// Fly a scenario by hand: as far as its steps go, or `until` says, or until it is over. Nothing is planned on or stored; `POST /v1/scenarios` judges what came of
/// it.
#[utoipa::path(
    post, path = "/flights", tag = "scenarios", request_body = FlightWish,
    responses(
        (status = 200, body = Flight), (status = 400, body = Problem), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem), (status = 503, body = Problem)
    )
)]
pub(super) async fn fly(
    _: NoQuery,
    State(app): State<AppState>,
    Json(body): Json<Value>,
) -> Result<axum::Json<Flight>, Problem> {
    let FlightWish { scenario, steps, until, from } = read(body)?;
    let scenario = by_user(&scenario)?;
    let flown = app.turns.flights.work(move |_| flown(&scenario, &steps, (from, until))).await?;
    Ok(axum::Json(flown?))
}

fn flown(scenario: &Scenario, steps: &[Value], (from, until): (u32, u32)) -> Result<Flight, Problem> {
    let task = scenario.task();
    let log = read_log(scenario, steps, Precision::F64, None).map_err(|error| refuse("", error.into()))?;
    let last = u32::try_from(steps.len()).unwrap_or(u32::MAX).max(until);
    if from > last {
        return Err(Problem::invalid(
            "from",
            format!("is step {from}, but it is flown to step {last} at most"),
        ));
    }
    let range = FrameRange { first: from, last, max_bytes: MAX_FRAME_BYTES };
    let frames =
        frames(scenario, &log, FrameContent::Telemetry, range).map_err(
            |error| match error {
                crate::frames::FramesError::Scenario(error) => refuse("", ReplayError::Scenario(error)),
                error => Problem::invalid("steps", error.to_string()),
            },
        )?;
    let done = frames.last().is_some_and(|frame| frame["done"] == true);
    Ok(Flight {
        scenario_id: scenario.id().to_string(),
        scenario: scenario.to_json(),
        done,
        horizon: task.horizon(scenario.recipe()),
        frames,
    })
}
