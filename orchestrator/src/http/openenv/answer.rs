//! What a session shows, as openenv-core writes it.

use axum::http::header;
use axum::response::{IntoResponse, Response};
use serde_json::{Value, json};

use crate::sessions::{ReportOutcome, SessionStatus, StepView};

/// `{"observation": …, "reward": …, "done": …}`, written without a detour: this is most of what a server does.
pub(super) fn observation(shown: &StepView<'_>, out: &mut Vec<u8>) {
    out.extend_from_slice(b"{\"observation\":");
    match shown.judged {
        None => shown.episode.write_observation(out),
        Some(_) => out.extend_from_slice(shown.observation().to_string().as_bytes()),
    }
    out.extend_from_slice(b",\"reward\":");
    out.extend_from_slice(Value::from(shown.reward).to_string().as_bytes());
    out.extend_from_slice(if shown.done { b",\"done\":true}" } else { b",\"done\":false}" });
}

/// The same to take apart.
pub(super) fn value(shown: &StepView<'_>) -> Value {
    json!({"observation": shown.observation(), "reward": shown.reward, "done": shown.done})
}

/// The same as an answer over HTTP.
pub(super) fn observed(shown: &StepView<'_>) -> Response {
    let mut body = Vec::with_capacity(8 * 1024);
    observation(shown, &mut body);
    ([(header::CONTENT_TYPE, "application/json")], body).into_response()
}

/// The state of a session: what openenv-core has, and beside it what is flown, for whom, and what became of it.
pub(super) fn state(standing: &SessionStatus<'_>) -> Value {
    let mut state = json!({"episode_id": standing.episode_id, "step_count": standing.steps});
    if let Some(scenario) = standing.scenario {
        state["task"] = json!(scenario.task().id());
        state["scenario_id"] = json!(scenario.id().to_string());
    }
    if let Some(run) = standing.run {
        state["run"] = json!(run);
        state["reported"] = match standing.outcome {
            Some(ReportOutcome::Acknowledged(receipt)) => json!(receipt),
            Some(ReportOutcome::Failed(words)) => json!({"status": "lost", "detail": words}),
            None => Value::Null,
        };
    }
    state
}
