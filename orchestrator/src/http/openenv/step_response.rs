//! Steps and states of a session in openenv-core's format.

use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use crate::sessions::{ReportOutcome, SessionStatus, StepView};

/// Writes `{"observation": …, "reward": …, "done": …}` without an intermediate value, since servers do little else.
pub(super) fn write_step(step: &StepView<'_>, out: &mut Vec<u8>) {
    out.extend_from_slice(b"{\"observation\":");
    match step.judged {
        None => step.episode.write_observation(out),
        Some(_) => out.extend_from_slice(step.observation().to_string().as_bytes()),
    }
    out.extend_from_slice(b",\"reward\":");
    out.extend_from_slice(Value::from(step.reward).to_string().as_bytes());
    out.extend_from_slice(if step.done { b",\"done\":true}" } else { b",\"done\":false}" });
}

/// Returns a step as a JSON value.
pub(super) fn step_value(step: &StepView<'_>) -> Value {
    json!({"observation": step.observation(), "reward": step.reward, "done": step.done})
}

/// Returns a step as an HTTP response.
pub(super) fn http_response(step: &StepView<'_>) -> Response {
    let mut body = Vec::with_capacity(8 * 1024);
    write_step(step, &mut body);
    ([(header::CONTENT_TYPE, "application/json")], body).into_response()
}

/// Returns the state of a session: openenv-core's fields, the scenario, the run, and the outcome of the report.
pub(super) fn state_value(status: &SessionStatus<'_>) -> Value {
    let mut state = json!({"episode_id": status.episode_id, "step_count": status.steps});
    if let Some(scenario) = status.scenario {
        state["task"] = json!(scenario.task().id());
        state["scenario_id"] = json!(scenario.id().to_string());
    }
    if let Some(run) = status.run {
        state["run"] = json!(run);
        state["reported"] = match status.outcome {
            Some(ReportOutcome::Acknowledged(receipt)) => json!(receipt),
            Some(ReportOutcome::Failed(reason)) => json!({"status": "lost", "detail": reason}),
            None => Value::Null,
        };
    }
    state
}
