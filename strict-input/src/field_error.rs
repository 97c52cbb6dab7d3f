//! The error of a field that cannot be read, with serde's messages in plain words.

use std::fmt;

use env_core::format_shortest;
use env_core::text::{MAX_QUOTED_CHARS, shorten};
use serde::de::{self, Expected, Unexpected};

/// Text before the list of known fields.
pub const KNOWN_FIELDS: &str = "the known fields are";

/// Error of a field that cannot be read: its path, and the reason.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct FieldError {
    /// Dotted path of the field, list items by their index from 0; empty for the whole document.
    pub field: String,
    /// Reason why the field is rejected, as a sentence without its subject.
    pub reason: String,
}

impl FieldError {
    fn new(reason: String) -> Self {
        Self { field: String::new(), reason }
    }

    /// Error of a key that appears twice.
    pub(super) fn duplicate(field: &str) -> Self {
        Self { field: shorten(field, MAX_QUOTED_CHARS), reason: "is given twice; send it once".to_owned() }
    }

    /// Error of a number that is NaN, infinite or beyond the range of a double.
    pub(super) fn not_finite(number: &str) -> Self {
        Self::new(format!("must be a finite number, got {}", shorten(number, MAX_QUOTED_CHARS)))
    }

    /// Error of an unknown key; `known` lists the known ones.
    pub fn unknown(name: &str, known: &str) -> Self {
        let remedy = if known.is_empty() {
            "this object has no fields".to_owned()
        } else {
            format!("{KNOWN_FIELDS} {known}")
        };
        Self { field: shorten(name, MAX_QUOTED_CHARS), reason: format!("is not a known field; {remedy}") }
    }

    /// Prefixes the path with the name of the object or list index that contains the field.
    pub(super) fn nested_in(mut self, name: &str) -> Self {
        let name = shorten(name, MAX_QUOTED_CHARS);
        self.field = if self.field.is_empty() { name } else { format!("{name}.{}", self.field) };
        self
    }
}

impl fmt::Display for FieldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.field.is_empty() {
            f.write_str(&self.reason)
        } else {
            write!(f, "{}: {}", self.field, self.reason)
        }
    }
}

impl std::error::Error for FieldError {}

impl de::Error for FieldError {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::new(message.to_string())
    }

    fn invalid_type(found: Unexpected<'_>, wanted: &dyn Expected) -> Self {
        Self::new(format!(
            "must be {}, got {}",
            describe_expected(&wanted.to_string()),
            describe_found(&found)
        ))
    }

    fn invalid_value(found: Unexpected<'_>, wanted: &dyn Expected) -> Self {
        Self::invalid_type(found, wanted)
    }

    fn invalid_length(length: usize, wanted: &dyn Expected) -> Self {
        Self::new(format!("must be {}, got {length} entries", describe_expected(&wanted.to_string())))
    }

    fn unknown_variant(word: &str, known: &'static [&'static str]) -> Self {
        Self::new(format!("must be one of {}, got {:?}", known.join(", "), shorten(word, MAX_QUOTED_CHARS)))
    }

    fn unknown_field(name: &str, known: &'static [&'static str]) -> Self {
        Self::unknown(name, &known.join(", "))
    }

    fn missing_field(name: &'static str) -> Self {
        Self { field: name.to_owned(), reason: "is required".to_owned() }
    }

    fn duplicate_field(name: &'static str) -> Self {
        Self::duplicate(name)
    }
}

/// Describes a value that was found.
fn describe_found(found: &Unexpected<'_>) -> String {
    match *found {
        Unexpected::Bool(value) => value.to_string(),
        Unexpected::Unsigned(number) => number.to_string(),
        Unexpected::Signed(number) => number.to_string(),
        Unexpected::Float(number) => format_shortest(number),
        Unexpected::Char(letter) => format!("{letter:?}"),
        Unexpected::Str(text) => format!("{:?}", shorten(text, MAX_QUOTED_CHARS)),
        Unexpected::Unit | Unexpected::Option => "null".to_owned(),
        Unexpected::Seq => "a list".to_owned(),
        Unexpected::Map => "an object".to_owned(),
        ref other => other.to_string(),
    }
}

/// Replaces serde's name of an expected type by plain words.
fn describe_expected(wanted: &str) -> String {
    let whole = |min: String, max: String| format!("an integer from {min} to {max}");
    match wanted {
        "u8" => whole("0".to_owned(), u8::MAX.to_string()),
        "u16" => whole("0".to_owned(), u16::MAX.to_string()),
        "u32" => whole("0".to_owned(), u32::MAX.to_string()),
        "u64" | "usize" => "an integer of at least 0".to_owned(),
        "i8" | "i16" | "i32" | "i64" | "isize" => "an integer".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a string" => "a string".to_owned(),
        "a sequence" => "a list".to_owned(),
        "a map" => "an object".to_owned(),
        _ if wanted.starts_with("struct ") => "an object".to_owned(),
        _ if wanted.starts_with("enum ") || wanted == "variant identifier" => "one of its values".to_owned(),
        _ => wanted.to_owned(),
    }
}
