//! Messages about a session, as JSON text.

use serde_json::{Map, Value, json};

use super::session_request::autoreset_word;
use crate::sessions::vector::frame::FRAME_VERSION;
use crate::sessions::{
    EpisodeTally, ReportOutcome, SessionStatus, SingleSession, StepView, VectorSession, VectorSource,
};

/// Writes a further field of an object, `,"name":value`.
fn write_field(out: &mut Vec<u8>, name: &str, value: &Value) {
    out.extend_from_slice(b",\"");
    out.extend_from_slice(name.as_bytes());
    out.extend_from_slice(b"\":");
    out.extend_from_slice(value.to_string().as_bytes());
}

/// Starts a message of a type.
fn write_type(out: &mut Vec<u8>, kind: &str) {
    out.extend_from_slice(b"{\"type\":\"");
    out.extend_from_slice(kind.as_bytes());
    out.push(b'"');
}

/// Writes `,"observation":…` directly, without a JSON value in between, since this is most of the server's work.
fn write_observation(out: &mut Vec<u8>, shown: &StepView<'_>) {
    out.extend_from_slice(b",\"observation\":");
    match shown.judged {
        None => shown.episode.write_observation(out),
        Some(_) => out.extend_from_slice(shown.observation().to_string().as_bytes()),
    }
}

/// Writes the scenario and the episode.
fn write_scenario(out: &mut Vec<u8>, status: &SessionStatus<'_>) {
    let Some(scenario) = status.scenario else { return };
    write_field(out, "task", &json!(scenario.task().id()));
    write_field(out, "scenario", &json!(scenario.id().to_string()));
    write_field(out, "seed", &json!(scenario.seed().get()));
    write_field(out, "agents", &json!(scenario.task().agents(scenario.recipe())));
    write_field(out, "horizon", &json!(scenario.task().horizon(scenario.recipe())));
    write_field(out, "episode", &json!(status.episode_id));
    if let Some(run) = status.run {
        write_field(out, "run", &json!(run));
    }
}

/// Outcome of the report of a session's episode; `None` if the session has no run.
fn report_json(status: &SessionStatus<'_>) -> Option<Value> {
    status.run?;
    Some(match status.outcome {
        Some(ReportOutcome::Acknowledged(receipt)) => json!(receipt),
        Some(ReportOutcome::Failed(words)) => json!({"status": "lost", "detail": words}),
        None => Value::Null,
    })
}

/// Message of type `opened`, `resumed` or `state`: the status of a session.
pub(super) fn status_message(kind: &str, single: &SingleSession, ttl_s: u64, id: Option<u64>) -> Vec<u8> {
    let status = single.session.status();
    let mut out = Vec::with_capacity(8 * 1024);
    write_type(&mut out, kind);
    if kind == "state" {
        write_field(&mut out, "id", &json!(id));
    }
    write_field(&mut out, "version", &json!(FRAME_VERSION));
    write_field(&mut out, "session", &json!(single.session.id()));
    write_field(&mut out, "ttl_s", &json!(ttl_s));
    write_field(&mut out, "mode", &json!("single"));
    write_scenario(&mut out, &status);
    if kind != "opened" {
        write_field(&mut out, "last_id", &json!(single.last_reply.as_ref().map(|reply| reply.id)));
        write_field(&mut out, "steps", &json!(status.steps));
        if let Ok(shown) = single.session.view() {
            write_field(&mut out, "done", &json!(shown.done));
        }
        if let Some(reported) = report_json(&status) {
            write_field(&mut out, "reported", &reported);
        }
    }
    if let Ok(shown) = single.session.view() {
        write_observation(&mut out, &shown);
    }
    out.push(b'}');
    out
}

/// Message of type `started`: another episode has started.
pub(super) fn began_message(single: &SingleSession, id: u64) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 * 1024);
    write_type(&mut out, "started");
    write_field(&mut out, "id", &json!(id));
    write_scenario(&mut out, &single.session.status());
    if let Ok(shown) = single.session.view() {
        write_observation(&mut out, &shown);
    }
    out.push(b'}');
    out
}

/// Message of type `stepped`. An episode is truncated if its horizon ended an agent, else terminated. `room` is the capacity of the
/// buffer, bytes.
pub(super) fn stepped_message(shown: &StepView<'_>, id: u64, room: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(room);
    write_type(&mut out, "stepped");
    write_field(&mut out, "id", &json!(id));
    write_field(&mut out, "step", &json!(shown.episode.steps()));
    write_observation(&mut out, shown);
    write_field(&mut out, "reward", &json!(shown.reward));
    out.extend_from_slice(b",\"agents\":[");
    for (place, agent) in shown.report.agents.iter().enumerate() {
        if place > 0 {
            out.push(b',');
        }
        out.extend_from_slice(format!("{{\"agent\":{}", agent.agent).as_bytes());
        write_field(&mut out, "reward", &json!(agent.reward));
        write_field(&mut out, "terminated", &Value::Bool(agent.terminated));
        write_field(&mut out, "truncated", &Value::Bool(agent.truncated));
        write_field(&mut out, "needs_action", &Value::Bool(agent.needs_action));
        out.push(b'}');
    }
    out.push(b']');
    let truncated = shown.done && shown.report.agents.iter().any(|agent| agent.truncated);
    write_field(&mut out, "terminated", &Value::Bool(shown.done && !truncated));
    write_field(&mut out, "truncated", &Value::Bool(truncated));
    write_field(&mut out, "done", &Value::Bool(shown.done));
    write_field(&mut out, "score", &json!(shown.done.then(|| shown.episode.outcome().score)));
    out.push(b'}');
    out
}

/// Appends the receipt to the last step of an episode of a run.
pub(super) fn append_receipt(out: &mut Vec<u8>, status: &SessionStatus<'_>) {
    if let Some(reported) = report_json(status) {
        out.pop();
        write_field(out, "reported", &reported);
        out.push(b'}');
    }
}

/// Message of type `opened`, `resumed` or `state`: the status of a vector session.
pub(super) fn vector_status_message(
    kind: &str,
    vector: &VectorSession,
    ttl_s: u64,
    id: Option<u64>,
) -> Vec<u8> {
    let layout = vector.layout();
    let mut fields = Map::new();
    let mut put = |name: &str, value: Value| drop(fields.insert(name.to_owned(), value));
    put("type", json!(kind));
    if kind == "state" {
        put("id", json!(id));
    }
    put("version", json!(FRAME_VERSION));
    put("session", json!(vector.token()));
    put("ttl_s", json!(ttl_s));
    put("mode", json!("vector"));
    put("task", json!(vector.task().id()));
    put("envs", json!(layout.envs));
    put("agents", json!(layout.agents));
    put("action", json!(layout.action));
    put("observation", json!(layout.observation));
    put("autoreset", json!(autoreset_word(vector.autoreset())));
    match vector.source() {
        VectorSource::Recipe { seed } => put("seed", json!(seed)),
        VectorSource::Lease { run, lease } => {
            put("run", json!(run.as_str()));
            put("lease_id", json!(lease.to_string()));
            put("episodes_left", json!(vector.remaining_episodes()));
        }
    }
    if kind != "opened" {
        put("sequence", json!(vector.last_frame().sequence));
        put("steps", json!(vector.steps()));
        if let Some(tally) = vector.tally() {
            put("reported", json!(tally));
        }
    }
    if kind != "state" {
        put("columns", json!(vector.columns()));
        put("frames", layout.describe());
    }
    Value::Object(fields).to_string().into_bytes()
}

/// Message of type `closed`: the session has ended.
pub(super) fn closed_message(id: Option<u64>, tally: Option<&EpisodeTally>) -> Vec<u8> {
    let mut message = json!({"type": "closed", "id": id});
    if let Some(tally) = tally {
        message["reported"] = json!(tally);
    }
    message.to_string().into_bytes()
}
