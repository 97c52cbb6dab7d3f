//! One environment, stepped by messages of text.

use std::ops::ControlFlow;

use axum::body::Bytes;
use serde::Deserialize;
use serde_json::{Map, Value};

use super::answer;
use super::opening::{Message, message, unknown};
use super::refusal::Refusal;
use super::wish;
use crate::input::from_value;
use crate::sessions::{LastReply, SingleSession};

/// Largest number a message may have: what every language's doubles hold.
const MOST_ID: u64 = (1 << 53) - 1;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Step {
    id: u64,
    action: Value,
}

/// A message that has nothing but perhaps a number.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Bare {
    pub(super) id: Option<u64>,
}

/// Answers one message; breaks where the client wants to go.
pub(super) async fn answer(single: &mut SingleSession, text: &str, ttl_s: u64) -> ControlFlow<Bytes, Bytes> {
    let Message { kind, id, fields } = match message(text) {
        Ok(message) => message,
        Err((id, refusal)) => return ControlFlow::Continue(refusal.message(id).into()),
    };
    let told = match kind.as_str() {
        "step" => step(single, fields).await,
        "reset" => reset(single, fields).await,
        "state" => from_value::<Bare>(Value::Object(fields))
            .map(|bare| answer::standing("state", single, ttl_s, bare.id).into())
            .map_err(Refusal::from),
        "close" => match from_value::<Bare>(Value::Object(fields)) {
            Ok(bare) => return ControlFlow::Break(answer::closed(bare.id, None).into()),
            Err(fault) => Err(fault.into()),
        },
        "open" | "resume" => Err(Refusal::new("already_open", "the session is open").at("type")),
        other => Err(unknown(other, "step, reset, state, close")),
    };
    ControlFlow::Continue(told.unwrap_or_else(|refusal| refusal.message(id).into()))
}

/// Whether a message of this number is new; else what answered it.
fn turn(single: &SingleSession, id: u64) -> Result<Option<Bytes>, Refusal> {
    if id > MOST_ID {
        return Err(Refusal::invalid("id", format!("it is {id}; at most {MOST_ID}")));
    }
    match &single.last_reply {
        Some(last) if last.id == id => Ok(Some(last.text.clone())),
        Some(last) if id < last.id => {
            let words =
                format!("it is {id}, and {} was answered since: only the last answer is kept", last.id);
            Err(Refusal::new("out_of_turn", words).at("id"))
        }
        _ => Ok(None),
    }
}

async fn step(single: &mut SingleSession, fields: Map<String, Value>) -> Result<Bytes, Refusal> {
    let Step { id, action } = from_value(Value::Object(fields))?;
    if let Some(told) = turn(single, id)? {
        return Ok(told);
    }
    // Observations grow a little from step to step.
    let room = single.last_reply.as_ref().map_or(4096, |last| last.text.len() + last.text.len() / 8 + 64);
    let shown = single.session.step(&action).await?;
    let done = shown.done;
    let mut told = answer::stepped(&shown, id, room);
    if done {
        answer::receipt(&mut told, &single.session.status());
    }
    let told = Bytes::from(told);
    single.last_reply = Some(LastReply { id, text: told.clone() });
    Ok(told)
}

async fn reset(single: &mut SingleSession, mut fields: Map<String, Value>) -> Result<Bytes, Refusal> {
    let number: Map<_, _> = fields.remove_entry("id").into_iter().collect();
    let Bare { id } = from_value(Value::Object(number))?;
    let id = id.ok_or_else(|| Refusal::invalid("id", "it is missing"))?;
    if let Some(told) = turn(single, id)? {
        return Ok(told);
    }
    // Who wishes nothing wishes the same again.
    let wish = if fields.is_empty() { single.request.clone() } else { wish::wish(fields)? };
    let wished = wish::sorted(wish.clone())?;
    single.session.reset(wished, wish.episode_id.clone()).await?;
    single.request = wish;
    let told = Bytes::from(answer::began(single, id));
    single.last_reply = Some(LastReply { id, text: told.clone() });
    Ok(told)
}
