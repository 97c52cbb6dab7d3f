//! Many environments: binary frames step, and a little is asked by text.

use std::ops::ControlFlow;

use axum::body::Bytes;
use serde_json::Value;

use super::answer;
use super::opening::{Message, message, unknown};
use super::refusal::Refusal;
use super::single::Bare;
use crate::input::from_value;
use crate::sessions::VectorSession;

/// Answers one message of text; breaks where the client wants to go.
pub(super) async fn text(vector: &mut VectorSession, text: &str, ttl_s: u64) -> ControlFlow<Bytes, Bytes> {
    let Message { kind, id, fields } = match message(text) {
        Ok(message) => message,
        Err((id, refusal)) => return ControlFlow::Continue(refusal.message(id).into()),
    };
    let bare = from_value::<Bare>(Value::Object(fields)).map_err(Refusal::from);
    let told = match (kind.as_str(), bare) {
        ("state", Ok(bare)) => Ok(answer::vector("state", vector, ttl_s, bare.id).into()),
        ("close", Ok(bare)) => {
            let tally = vector.finish().await;
            return ControlFlow::Break(answer::closed(bare.id, tally.as_ref()).into());
        }
        ("state" | "close", Err(refusal)) => Err(refusal),
        ("open" | "resume", _) => Err(Refusal::new("already_open", "the session is open").at("type")),
        ("step" | "reset", _) => {
            Err(Refusal::invalid("type", "a vector session is stepped and reset by binary frames"))
        }
        (other, _) => Err(unknown(other, "state, close; steps are binary frames")),
    };
    ControlFlow::Continue(told.unwrap_or_else(|refusal: Refusal| refusal.message(id).into()))
}

/// What a binary frame is answered with.
pub(super) enum Told {
    /// A frame.
    Frame(Bytes),
    /// An error; the session goes on.
    Error(Bytes),
    /// An error; the session is of no use any more.
    End(Bytes),
}

/// Answers one binary frame.
pub(super) async fn frame(vector: &mut VectorSession, bytes: Bytes) -> Told {
    // The number, where there is one, so that the client knows which frame is meant.
    let number = bytes.get(8..12).and_then(|bytes| bytes.try_into().ok()).map(u32::from_le_bytes);
    match vector.answer(bytes).await {
        Ok(frame) => Told::Frame(frame),
        Err(error) => {
            let refusal = Refusal::from(error);
            let told = refusal.message(number.map(u64::from)).into();
            if refusal.ends { Told::End(told) } else { Told::Error(told) }
        }
    }
}
