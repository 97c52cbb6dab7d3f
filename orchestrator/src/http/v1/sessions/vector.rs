//! Session with many environments, which are stepped by binary frames; text messages query its status and close it.

use std::ops::ControlFlow;

use axum::body::Bytes;
use serde_json::Value;

use super::error_message::ErrorMessage;
use super::messages;
use super::open::{ClientMessage, parse_message, unknown_type};
use super::single::IdField;
use crate::sessions::VectorSession;
use strict_input::from_value;

/// Answers one text message. Returns `Break` if the client closes the session.
pub(super) async fn answer_text(
    vector: &mut VectorSession,
    text: &str,
    ttl_s: u64,
) -> ControlFlow<Bytes, Bytes> {
    let ClientMessage { kind, id, fields } = match parse_message(text) {
        Ok(message) => message,
        Err((id, error)) => return ControlFlow::Continue(error.to_json(id).into()),
    };
    let fields = from_value::<IdField>(Value::Object(fields)).map_err(ErrorMessage::from);
    let reply = match (kind.as_str(), fields) {
        ("state", Ok(field)) => Ok(messages::vector_status_message("state", vector, ttl_s, field.id).into()),
        ("close", Ok(field)) => {
            let tally = vector.finish().await;
            return ControlFlow::Break(messages::closed_message(field.id, tally.as_ref()).into());
        }
        ("state" | "close", Err(error)) => Err(error),
        ("open" | "resume", _) => {
            Err(ErrorMessage::new("already_open", "the session is already open; send it on a new connection")
                .at("type"))
        }
        ("step" | "reset", _) => Err(ErrorMessage::invalid(
            "type",
            "must be state or close: send steps and resets of a vector session as binary frames",
        )),
        (other, _) => Err(unknown_type(other, "state or close, or a binary frame")),
    };
    ControlFlow::Continue(reply.unwrap_or_else(|error: ErrorMessage| error.to_json(id).into()))
}

/// Reply to a binary frame.
pub(super) enum FrameReply {
    /// Frame with observations and rewards.
    Frame(Bytes),
    /// Error after which the session goes on.
    Error(Bytes),
    /// Error that ends the session.
    End(Bytes),
}

/// Answers one binary frame.
pub(super) async fn answer_frame(vector: &mut VectorSession, bytes: Bytes) -> FrameReply {
    // Sequence number of the frame, so that the client can match the error.
    let sequence = bytes.get(8..12).and_then(|bytes| bytes.try_into().ok()).map(u32::from_le_bytes);
    match vector.answer(bytes).await {
        Ok(frame) => FrameReply::Frame(frame),
        Err(error) => {
            let error = ErrorMessage::from(error);
            let reply = error.to_json(sequence.map(u64::from)).into();
            if error.ends_session { FrameReply::End(reply) } else { FrameReply::Error(reply) }
        }
    }
}
