//! Validation errors of a message in pydantic's form.

use std::io::{self, Write};

use serde::Serialize;
use serde_json::Value;

/// Largest number of errors that are reported for one message.
pub const MAX_ERRORS: usize = 32;
/// Largest length of an echoed input, in bytes of JSON. A longer one is echoed as the beginning of its JSON, in a string
/// that ends in "…". Field names in locations are cut at the same length.
pub const MAX_ECHO_BYTES: usize = 2048;

/// One validation error of a message. It serialises to pydantic's form without `url`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ValidationError {
    /// Kind of error in pydantic's vocabulary, such as `missing` or `float_parsing`.
    #[serde(rename = "type")]
    pub kind: &'static str,
    /// Location of the error, from the root of the message.
    pub loc: Vec<LocSegment>,
    /// Description of the value that was expected.
    pub msg: String,
    /// Value that was found, shortened to [`MAX_ECHO_BYTES`].
    pub input: Value,
    /// Numbers and words that `msg` contains, if any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ctx: Option<Value>,
}

impl std::fmt::Display for ValidationError {
    /// Writes the dotted location and the expected value.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (index, segment) in self.loc.iter().enumerate() {
            let dot = if index == 0 { "" } else { "." };
            match segment {
                LocSegment::Field(name) => write!(f, "{dot}{name}")?,
                LocSegment::Index(index) => write!(f, "{dot}{index}")?,
            }
        }
        write!(f, ": {}", self.msg)
    }
}

/// One segment of the location of an error.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum LocSegment {
    /// Name of an object's field.
    Field(String),
    /// Index of a list's element, counted from 0.
    Index(usize),
}

impl From<&str> for LocSegment {
    fn from(name: &str) -> Self {
        Self::Field(truncate(name))
    }
}

impl From<usize> for LocSegment {
    fn from(index: usize) -> Self {
        Self::Index(index)
    }
}

/// Collects the first [`MAX_ERRORS`] errors of one message.
#[derive(Debug, Default)]
pub(crate) struct ErrorCollector(Vec<ValidationError>);

impl ErrorCollector {
    /// Adds an error unless the limit is reached.
    pub(crate) fn add(
        &mut self,
        kind: &'static str,
        loc: Vec<LocSegment>,
        msg: impl Into<String>,
        input: &Value,
    ) {
        self.push(kind, loc, msg.into(), input, None);
    }

    /// Adds an error with pydantic's context unless the limit is reached.
    pub(crate) fn add_with_context(
        &mut self,
        kind: &'static str,
        loc: Vec<LocSegment>,
        msg: impl Into<String>,
        input: &Value,
        ctx: Value,
    ) {
        self.push(kind, loc, msg.into(), input, Some(ctx));
    }

    /// True if the limit is reached and further errors are dropped.
    pub(crate) fn is_full(&self) -> bool {
        self.0.len() >= MAX_ERRORS
    }

    /// Returns the collected errors as an `Err` if there are any.
    pub(crate) fn into_result(self) -> Result<(), Vec<ValidationError>> {
        if self.0.is_empty() { Ok(()) } else { Err(self.0) }
    }

    /// Adds an error, with pydantic's context if there is one, unless the limit is reached.
    pub(crate) fn push(
        &mut self,
        kind: &'static str,
        loc: Vec<LocSegment>,
        msg: String,
        input: &Value,
        ctx: Option<Value>,
    ) {
        if !self.is_full() {
            self.0.push(ValidationError { kind, loc, msg, input: echo_input(input), ctx });
        }
    }
}

/// Returns the input, or the beginning of its JSON if that is longer than [`MAX_ECHO_BYTES`]. The time it takes is bounded
/// by the length of the result.
#[must_use]
pub fn echo_input(input: &Value) -> Value {
    let mut prefix = PrefixWriter(Vec::new());
    if serde_json::to_writer(&mut prefix, input).is_ok() {
        return input.clone();
    }
    Value::String(truncate(&String::from_utf8_lossy(&prefix.0)))
}

/// Returns the text, or its beginning and "…" if it is longer than [`MAX_ECHO_BYTES`].
fn truncate(text: &str) -> String {
    const ELLIPSIS: &str = "…";
    if text.len() <= MAX_ECHO_BYTES {
        return text.to_owned();
    }
    let end = text.floor_char_boundary(MAX_ECHO_BYTES - ELLIPSIS.len());
    [&text[..end], ELLIPSIS].concat()
}

/// Writer that keeps the first bytes, and fails after more than [`MAX_ECHO_BYTES`].
struct PrefixWriter(Vec<u8>);

impl Write for PrefixWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // Four bytes more than are echoed, so that a character split at the end lies behind the cut.
        let room = (MAX_ECHO_BYTES + 4).saturating_sub(self.0.len());
        self.0.extend_from_slice(&bytes[..bytes.len().min(room)]);
        if self.0.len() > MAX_ECHO_BYTES { Err(io::ErrorKind::FileTooLarge.into()) } else { Ok(bytes.len()) }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
