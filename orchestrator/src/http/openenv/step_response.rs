//! Steps and states of a session in openenv-core's format.

use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use crate::sessions::{ReportOutcome, Session, SessionError, SessionStatus, StepView};

/// Writes the last step of a session: `{"observation": …, "reward": …, "done": …}`, without an intermediate value, since servers
/// do little else. The first and the last step of an episode have the state of the session, without the
/// id of the episode, as `metadata`.
///
/// # Errors
/// Returns [`SessionError::NotStarted`] before the first reset.
pub(super) fn write_step(session: &Session, out: &mut Vec<u8>) -> Result<(), SessionError> {
    let step = &session.view()?;
    out.extend_from_slice(b"{\"observation\":");
    match step.judged {
        None => step.episode.write_observation(out),
        Some(_) => out.extend_from_slice(step.observation().to_string().as_bytes()),
    }
    out.extend_from_slice(b",\"reward\":");
    out.extend_from_slice(Value::from(step.reward).to_string().as_bytes());
    out.extend_from_slice(if step.done { b",\"done\":true" } else { b",\"done\":false" });
    let status = session.status();
    if step.done || status.steps == 0 {
        out.extend_from_slice(b",\"metadata\":");
        let mut metadata = state_value(&status);
        // Equal scenarios have equal responses.
        metadata.as_object_mut().map(|fields| fields.remove("episode_id"));
        out.extend_from_slice(metadata.to_string().as_bytes());
    }
    out.push(b'}');
    Ok(())
}

/// Returns a step as a JSON value.
pub(super) fn step_value(step: &StepView<'_>) -> Value {
    json!({"observation": step.observation(), "reward": step.reward, "done": step.done})
}

/// Returns the last step of a session as an HTTP response.
///
/// # Errors
/// Returns [`SessionError::NotStarted`] before the first reset.
pub(super) fn http_response(session: &Session) -> Result<Response, SessionError> {
    let mut body = Vec::with_capacity(8 * 1024);
    write_step(session, &mut body)?;
    Ok(([(header::CONTENT_TYPE, "application/json")], body).into_response())
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
