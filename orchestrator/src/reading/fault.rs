//! What is wrong, and where.

use std::fmt;

use env_core::told;
use serde::de::{self, Expected, Unexpected};

/// Most characters of what a stranger wrote in a message.
const MOST: usize = 60;

/// A field that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Fault {
    /// A dotted path, places in lists counted from 0; empty for the whole.
    pub(crate) field: String,
    /// What is wrong with it.
    pub(crate) words: String,
}

impl Fault {
    fn new(words: String) -> Self {
        Self { field: String::new(), words }
    }

    /// A key that is there twice.
    pub(super) fn twice(field: &str) -> Self {
        Self { field: shorten(field), words: "it is given twice; which is meant?".to_owned() }
    }

    /// A key that nobody knows, where these are known.
    pub(crate) fn unknown(name: &str, known: &str) -> Self {
        let known =
            if known.is_empty() { "there are none here".to_owned() } else { format!("known are {known}") };
        Self { field: shorten(name), words: format!("it is not a known field; {known}") }
    }

    /// The same, seen from one level up.
    pub(super) fn within(mut self, name: &str) -> Self {
        self.field =
            if self.field.is_empty() { shorten(name) } else { format!("{}.{}", shorten(name), self.field) };
        self
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.field.is_empty() {
            f.write_str(&self.words)
        } else {
            write!(f, "{}: {}", self.field, self.words)
        }
    }
}

impl std::error::Error for Fault {}

impl de::Error for Fault {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Self::new(message.to_string())
    }

    fn invalid_type(found: Unexpected<'_>, wanted: &dyn Expected) -> Self {
        Self::new(format!("it is {}, but must be {}", seen(&found), plain(&wanted.to_string())))
    }

    fn invalid_value(found: Unexpected<'_>, wanted: &dyn Expected) -> Self {
        Self::invalid_type(found, wanted)
    }

    fn invalid_length(length: usize, wanted: &dyn Expected) -> Self {
        Self::new(format!("it has {length} entries, but must be {}", plain(&wanted.to_string())))
    }

    fn unknown_variant(word: &str, known: &'static [&'static str]) -> Self {
        Self::new(format!("it is {:?}; choose one of {}", shorten(word), known.join(", ")))
    }

    fn unknown_field(name: &str, known: &'static [&'static str]) -> Self {
        Self::unknown(name, &known.join(", "))
    }

    fn missing_field(name: &'static str) -> Self {
        Self { field: name.to_owned(), words: "it is missing".to_owned() }
    }

    fn duplicate_field(name: &'static str) -> Self {
        Self::twice(name)
    }
}

/// What was found.
fn seen(found: &Unexpected<'_>) -> String {
    match *found {
        Unexpected::Bool(value) => value.to_string(),
        Unexpected::Unsigned(number) => number.to_string(),
        Unexpected::Signed(number) => number.to_string(),
        Unexpected::Float(number) => told(number),
        Unexpected::Char(letter) => format!("{letter:?}"),
        Unexpected::Str(text) => format!("{:?}", shorten(text)),
        Unexpected::Unit | Unexpected::Option => "null".to_owned(),
        Unexpected::Seq => "a list".to_owned(),
        Unexpected::Map => "an object".to_owned(),
        ref other => other.to_string(),
    }
}

/// What serde calls a thing, as people do.
fn plain(wanted: &str) -> String {
    let whole = |least: String, most: String| format!("a whole number from {least} to {most}");
    match wanted {
        "u8" => whole("0".to_owned(), u8::MAX.to_string()),
        "u16" => whole("0".to_owned(), u16::MAX.to_string()),
        "u32" => whole("0".to_owned(), u32::MAX.to_string()),
        "u64" | "usize" => "a whole number, 0 or more".to_owned(),
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a string" => "text in quotes".to_owned(),
        "a sequence" => "a list".to_owned(),
        "a map" => "an object".to_owned(),
        _ if wanted.starts_with("struct ") => "an object".to_owned(),
        _ if wanted.starts_with("enum ") || wanted == "variant identifier" => "one of its words".to_owned(),
        _ => wanted.to_owned(),
    }
}

/// What strangers wrote may be long; a message is not.
fn shorten(text: &str) -> String {
    if text.chars().count() <= MOST {
        text.to_owned()
    } else {
        text.chars().take(MOST - 3).chain("...".chars()).collect()
    }
}
