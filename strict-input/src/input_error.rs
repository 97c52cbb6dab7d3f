//! Limits of an input, and the error of an input that cannot be parsed.

use std::fmt;

use super::FieldError;

/// Largest content of one input. A value takes 32 bytes of memory, but as little as one byte of the input; a key takes about 100.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct InputLimits {
    /// Maximum number of values, objects and lists included.
    pub values: usize,
    /// Maximum number of keys of all objects together.
    pub keys: usize,
}

impl InputLimits {
    /// Limits of a file that a user names on the command line.
    pub const FILE: Self = Self { values: 4_000_000, keys: 1_000_000 };

    /// Returns the error of an input that exceeds the limit of one kind.
    pub(super) fn error(self, kind: ContentKind) -> InputError {
        let (limit, name) = match kind {
            ContentKind::Values => (self.values, "values"),
            ContentKind::Keys => (self.keys, "keys"),
        };
        InputError::TooLarge(format!("it has more than {limit} {name}; send less at a time"))
    }
}

/// Kind of content that [`InputLimits`] limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ContentKind {
    Values,
    Keys,
}

/// Error of an input that cannot be parsed.
#[derive(Debug)]
pub enum InputError {
    /// The bytes are not JSON or not MessagePack; the parser's message.
    Malformed(String),
    /// The input has more values or keys than its limits; a clause that says how many it may have.
    TooLarge(String),
    /// An object has the same key twice, or a number is not finite.
    Field(FieldError),
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Malformed(message) | Self::TooLarge(message) => f.write_str(message),
            Self::Field(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for InputError {}
