//! JSON as Python's `json` module writes it.

use serde::de::Error as _;
use serde_json::Value;
use strict_input::{InputLimits, JsonContent, non_finite_literals};

/// Largest content of one text.
pub const INPUT_LIMITS: InputLimits = InputLimits { values: 100_000, keys: 20_000 };

/// Parses JSON, and the extensions that Python's `json` writes: `NaN`, `Infinity`, `-Infinity` and numbers beyond the range
/// of a double. Those become strings of the same letters. Number parsers reject them as `finite_number`, so the error
/// names the field instead of a column of the text. The time is linear in the text; `serde_json` bounds the nesting.
///
/// # Errors
/// Returns the parser's error if the text is not JSON even with those extensions, and an error if it has more content than
/// [`INPUT_LIMITS`] allow.
pub fn parse_python_json(text: &str) -> serde_json::Result<Value> {
    // Short text is within the limits: a value has at least one byte, a key more.
    if text.len() > INPUT_LIMITS.keys {
        JsonContent::check_text(text.as_bytes(), INPUT_LIMITS).map_err(serde_json::Error::custom)?;
    }
    match serde_json::from_str(text) {
        Ok(value) => Ok(value),
        Err(error) => match quote_extensions(text) {
            Some(text) => serde_json::from_str(&text),
            None => Err(error),
        },
    }
}

/// Returns the text with Python's extensions in quotes, or `None` if it contains none.
fn quote_extensions(text: &str) -> Option<String> {
    let mut out = String::new();
    let mut copied = 0;
    for literal in non_finite_literals(text.as_bytes()) {
        out.push_str(&text[copied..literal.range.start]);
        out.extend(["\"", &literal.text, "\""]);
        copied = literal.range.end;
    }
    out.push_str(&text[copied..]);
    (copied > 0).then_some(out)
}
