//! What is told of a session, as messages.

use serde_json::{Map, Value, json};

use super::wish::autoreset_word;
use crate::sessions::vector::frame::FRAME_VERSION;
use crate::sessions::{ReportOutcome, SingleSession, VectorSource, SessionStatus, StepView, EpisodeTally, VectorSession};

/// Writes `,"name":value`.
fn put(out: &mut Vec<u8>, name: &str, value: &Value) {
    out.extend_from_slice(b",\"");
    out.extend_from_slice(name.as_bytes());
    out.extend_from_slice(b"\":");
    out.extend_from_slice(value.to_string().as_bytes());
}

fn begin(out: &mut Vec<u8>, kind: &str) {
    out.extend_from_slice(b"{\"type\":\"");
    out.extend_from_slice(kind.as_bytes());
    out.push(b'"');
}

/// Writes `,"observation":…` without a detour: this is most of what a server does.
fn observation(out: &mut Vec<u8>, shown: &StepView<'_>) {
    out.extend_from_slice(b",\"observation\":");
    match shown.judged {
        None => shown.episode.write_observation(out),
        Some(_) => out.extend_from_slice(shown.observation().to_string().as_bytes()),
    }
}

/// What is flown.
fn flown(out: &mut Vec<u8>, standing: &SessionStatus<'_>) {
    let Some(scenario) = standing.scenario else { return };
    put(out, "task", &json!(scenario.task().id()));
    put(out, "scenario", &json!(scenario.id().to_string()));
    put(out, "seed", &json!(scenario.seed().get()));
    put(out, "agents", &json!(scenario.task().agents(scenario.recipe())));
    put(out, "horizon", &json!(scenario.task().horizon(scenario.recipe())));
    put(out, "episode", &json!(standing.episode_id));
    if let Some(run) = standing.run {
        put(out, "run", &json!(run));
    }
}

fn reported(standing: &SessionStatus<'_>) -> Option<Value> {
    standing.run?;
    Some(match standing.outcome {
        Some(ReportOutcome::Acknowledged(receipt)) => json!(receipt),
        Some(ReportOutcome::Failed(words)) => json!({"status": "lost", "detail": words}),
        None => Value::Null,
    })
}

/// A session was opened (`opened`), come back to (`resumed`), or asked where it stands (`state`).
pub(super) fn standing(kind: &str, single: &SingleSession, ttl_s: u64, id: Option<u64>) -> Vec<u8> {
    let standing = single.session.status();
    let mut out = Vec::with_capacity(8 * 1024);
    begin(&mut out, kind);
    if kind == "state" {
        put(&mut out, "id", &json!(id));
    }
    put(&mut out, "version", &json!(FRAME_VERSION));
    put(&mut out, "session", &json!(single.session.id()));
    put(&mut out, "ttl_s", &json!(ttl_s));
    put(&mut out, "mode", &json!("single"));
    flown(&mut out, &standing);
    if kind != "opened" {
        put(&mut out, "last_id", &json!(single.last_reply.as_ref().map(|reply| reply.id)));
        put(&mut out, "steps", &json!(standing.steps));
        if let Ok(shown) = single.session.view() {
            put(&mut out, "done", &json!(shown.done));
        }
        if let Some(reported) = reported(&standing) {
            put(&mut out, "reported", &reported);
        }
    }
    if let Ok(shown) = single.session.view() {
        observation(&mut out, &shown);
    }
    out.push(b'}');
    out
}

/// Another episode began.
pub(super) fn began(single: &SingleSession, id: u64) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 * 1024);
    begin(&mut out, "began");
    put(&mut out, "id", &json!(id));
    flown(&mut out, &single.session.status());
    if let Ok(shown) = single.session.view() {
        observation(&mut out, &shown);
    }
    out.push(b'}');
    out
}

/// A step was taken. An episode is truncated where its horizon cut an agent off, else terminated.
pub(super) fn stepped(shown: &StepView<'_>, id: u64, room: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(room);
    begin(&mut out, "stepped");
    put(&mut out, "id", &json!(id));
    put(&mut out, "step", &json!(shown.episode.steps()));
    observation(&mut out, shown);
    put(&mut out, "reward", &json!(shown.reward));
    out.extend_from_slice(b",\"agents\":[");
    for (place, told) in shown.report.agents.iter().enumerate() {
        if place > 0 {
            out.push(b',');
        }
        out.extend_from_slice(format!("{{\"agent\":{}", told.agent).as_bytes());
        put(&mut out, "reward", &json!(told.reward));
        put(&mut out, "terminated", &Value::Bool(told.terminated));
        put(&mut out, "truncated", &Value::Bool(told.truncated));
        put(&mut out, "needs_action", &Value::Bool(told.needs_action));
        out.push(b'}');
    }
    out.push(b']');
    let truncated = shown.done && shown.report.agents.iter().any(|told| told.truncated);
    put(&mut out, "terminated", &Value::Bool(shown.done && !truncated));
    put(&mut out, "truncated", &Value::Bool(truncated));
    put(&mut out, "done", &Value::Bool(shown.done));
    put(&mut out, "score", &json!(shown.done.then(|| shown.episode.outcome().score)));
    out.push(b'}');
    out
}

/// Adds what became of the outcome to the last step of an episode that flew for a run.
pub(super) fn receipt(out: &mut Vec<u8>, standing: &SessionStatus<'_>) {
    if let Some(reported) = reported(standing) {
        out.pop();
        put(out, "reported", &reported);
        out.push(b'}');
    }
}

/// A vector session was opened, come back to, or asked where it stands.
pub(super) fn vector(kind: &str, vector: &VectorSession, ttl_s: u64, id: Option<u64>) -> Vec<u8> {
    let layout = vector.layout();
    let mut told = Map::new();
    let mut put = |name: &str, value: Value| drop(told.insert(name.to_owned(), value));
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
            put("left", json!(vector.remaining_episodes()));
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
    Value::Object(told).to_string().into_bytes()
}

/// A session ended.
pub(super) fn closed(id: Option<u64>, tally: Option<&EpisodeTally>) -> Vec<u8> {
    let mut told = json!({"type": "closed", "id": id});
    if let Some(tally) = tally {
        told["reported"] = json!(tally);
    }
    told.to_string().into_bytes()
}
