//! Session with one environment, which is stepped by text messages.

use std::ops::ControlFlow;

use axum::body::Bytes;
use serde::Deserialize;
use serde_json::{Map, Value};

use super::error_message::ErrorMessage;
use super::messages;
use super::open::{ClientMessage, parse_message, unknown_type};
use super::session_request;
use crate::sessions::{LastReply, SingleSession};
use strict_input::from_value;

/// Largest id of a message: the largest integer that a double represents exactly in every language.
const MAX_MESSAGE_ID: u64 = (1 << 53) - 1;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StepFields {
    id: u64,
    action: Value,
}

/// Fields of a message that has at most an id.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct IdField {
    /// Id of the message.
    pub(super) id: Option<u64>,
}

/// Answers one message. Returns `Break` if the client closes the session.
pub(super) async fn answer(single: &mut SingleSession, text: &str, ttl_s: u64) -> ControlFlow<Bytes, Bytes> {
    let ClientMessage { kind, id, fields } = match parse_message(text) {
        Ok(message) => message,
        Err((id, error)) => return ControlFlow::Continue(error.to_json(id).into()),
    };
    let reply = match kind.as_str() {
        "step" => step(single, fields).await,
        "reset" => reset(single, fields).await,
        "state" => from_value::<IdField>(Value::Object(fields))
            .map(|field| messages::status_message("state", single, ttl_s, field.id).into())
            .map_err(ErrorMessage::from),
        "close" => match from_value::<IdField>(Value::Object(fields)) {
            Ok(field) => return ControlFlow::Break(messages::closed_message(field.id, None).into()),
            Err(fault) => Err(fault.into()),
        },
        "open" | "resume" => {
            Err(ErrorMessage::new("already_open", "the session is already open; send it on a new connection")
                .at("type"))
        }
        other => Err(unknown_type(other, "step, reset, state or close")),
    };
    ControlFlow::Continue(reply.unwrap_or_else(|error| error.to_json(id).into()))
}

/// Returns the stored reply if the message with this id was answered before; `None` for a new message.
fn repeated_reply(single: &SingleSession, id: u64) -> Result<Option<Bytes>, ErrorMessage> {
    if id > MAX_MESSAGE_ID {
        return Err(ErrorMessage::invalid("id", format!("must be at most {MAX_MESSAGE_ID}, got {id}")));
    }
    match &single.last_reply {
        Some(last) if last.id == id => Ok(Some(last.text.clone())),
        Some(last) if id < last.id => {
            let words = format!("must be at least {}, the id of the last reply, got {id}", last.id);
            Err(ErrorMessage::new("out_of_order", words).at("id"))
        }
        _ => Ok(None),
    }
}

async fn step(single: &mut SingleSession, fields: Map<String, Value>) -> Result<Bytes, ErrorMessage> {
    let StepFields { id, action } = from_value(Value::Object(fields))?;
    if let Some(reply) = repeated_reply(single, id)? {
        return Ok(reply);
    }
    // Observations grow slightly from step to step.
    let room = single.last_reply.as_ref().map_or(4096, |last| last.text.len() + last.text.len() / 8 + 64);
    let shown = single.session.step(&action).await?;
    let done = shown.done;
    let mut reply = messages::stepped_message(&shown, id, room);
    if done {
        messages::append_receipt(&mut reply, &single.session.status());
    }
    let reply = Bytes::from(reply);
    single.last_reply = Some(LastReply { id, text: reply.clone() });
    Ok(reply)
}

async fn reset(single: &mut SingleSession, mut fields: Map<String, Value>) -> Result<Bytes, ErrorMessage> {
    let number: Map<_, _> = fields.remove_entry("id").into_iter().collect();
    let IdField { id } = from_value(Value::Object(number))?;
    let id = id.ok_or_else(|| ErrorMessage::invalid("id", "is required"))?;
    if let Some(reply) = repeated_reply(single, id)? {
        return Ok(reply);
    }
    // A reset without fields repeats the last request.
    let request =
        if fields.is_empty() { single.request.clone() } else { session_request::session_request(fields)? };
    let source = session_request::episode_source(request.clone()).await?;
    single.session.reset(source, request.episode_id.clone()).await?;
    single.request = request;
    let reply = Bytes::from(messages::began_message(single, id));
    single.last_reply = Some(LastReply { id, text: reply.clone() });
    Ok(reply)
}
