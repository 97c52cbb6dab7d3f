//! Faults of a message, as pydantic tells them.

use std::io::{self, Write};

use serde::Serialize;
use serde_json::Value;

/// Most faults that one message is told of.
pub const MAX_FAULTS: usize = 32;
/// An input whose JSON is longer than this is echoed as the beginning of that JSON, in a string that ends in "…". Names of
/// fields are cut there too.
pub const MAX_ECHO_BYTES: usize = 2048;

/// One fault of a message, as pydantic tells it; serialises to that form, but for pydantic's `url`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WireFault {
    /// Which kind, in pydantic's word: `missing`, `float_parsing` …
    #[serde(rename = "type")]
    pub kind: &'static str,
    /// Where, from the message on.
    pub loc: Vec<Place>,
    /// What should have stood there.
    pub msg: String,
    /// What stood there.
    pub input: Value,
    /// The numbers or words in `msg`, where there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ctx: Option<Value>,
}

impl std::fmt::Display for WireFault {
    /// The place, dotted, and what should have stood there.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (at, place) in self.loc.iter().enumerate() {
            let dot = if at == 0 { "" } else { "." };
            match place {
                Place::Field(name) => write!(f, "{dot}{name}")?,
                Place::Index(index) => write!(f, "{dot}{index}")?,
            }
        }
        write!(f, ": {}", self.msg)
    }
}

/// One step of the way to a fault.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Place {
    /// A field of an object.
    Field(String),
    /// An element of a list, counted from 0.
    Index(usize),
}

impl From<&str> for Place {
    fn from(name: &str) -> Self {
        Self::Field(cut(name))
    }
}

impl From<usize> for Place {
    fn from(index: usize) -> Self {
        Self::Index(index)
    }
}

/// The faults of one message as they are found.
#[derive(Debug, Default)]
pub(super) struct Faults(Vec<WireFault>);

impl Faults {
    /// Notes one, if there is room.
    pub(super) fn add(&mut self, kind: &'static str, loc: Vec<Place>, msg: impl Into<String>, input: &Value) {
        self.push(kind, loc, msg.into(), input, None);
    }

    /// The same with what pydantic calls its context.
    pub(super) fn add_with(
        &mut self,
        kind: &'static str,
        loc: Vec<Place>,
        msg: impl Into<String>,
        input: &Value,
        ctx: Value,
    ) {
        self.push(kind, loc, msg.into(), input, Some(ctx));
    }

    fn push(&mut self, kind: &'static str, loc: Vec<Place>, msg: String, input: &Value, ctx: Option<Value>) {
        if !self.full() {
            self.0.push(WireFault { kind, loc, msg, input: echo(input), ctx });
        }
    }

    /// No more are told.
    pub(super) fn full(&self) -> bool {
        self.0.len() >= MAX_FAULTS
    }

    /// `Ok` if there are none.
    pub(super) fn none(self) -> Result<(), Vec<WireFault>> {
        if self.0.is_empty() { Ok(()) } else { Err(self.0) }
    }
}

/// The input as it was, or the beginning of its JSON. Takes no longer than writing that beginning does.
#[must_use]
pub fn echo(input: &Value) -> Value {
    let mut beginning = Beginning(Vec::new());
    if serde_json::to_writer(&mut beginning, input).is_ok() {
        return input.clone();
    }
    Value::String(cut(&String::from_utf8_lossy(&beginning.0)))
}

/// The text, or the beginning of it and "…".
fn cut(text: &str) -> String {
    const MORE: &str = "…";
    if text.len() <= MAX_ECHO_BYTES {
        return text.to_owned();
    }
    let end = text.floor_char_boundary(MAX_ECHO_BYTES - MORE.len());
    [&text[..end], MORE].concat()
}

/// Takes the first bytes of what is written, and fails once there are more than are echoed.
struct Beginning(Vec<u8>);

impl Write for Beginning {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // A little more than is echoed, so that a character cut in half lies behind the cut.
        let room = (MAX_ECHO_BYTES + 4).saturating_sub(self.0.len());
        self.0.extend_from_slice(&bytes[..bytes.len().min(room)]);
        if self.0.len() > MAX_ECHO_BYTES { Err(io::ErrorKind::FileTooLarge.into()) } else { Ok(bytes.len()) }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
