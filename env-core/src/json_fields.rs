//! Field-by-field readers of JSON, whose errors name the field.

use serde_json::{Map, Value};

use crate::error::ScenarioError;
use crate::text::{MAX_QUOTED_CHARS, shorten};

/// Reads a JSON object.
pub(crate) fn read_object<'a>(
    field: &str,
    value: &'a Value,
) -> Result<&'a Map<String, Value>, ScenarioError> {
    value.as_object().ok_or_else(|| wrong_type(field, value, "an object"))
}

/// Rejects the first field that is not one of `names`; `prefix` is the dotted path of the object.
pub(crate) fn reject_unknown_fields(
    prefix: &str,
    fields: &Map<String, Value>,
    names: &[&str],
) -> Result<(), ScenarioError> {
    match fields.keys().find(|key| !names.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => Err(ScenarioError::UnknownField {
            field: format!("{prefix}{}", shorten(key, MAX_QUOTED_CHARS)),
            known: names.join(", "),
        }),
    }
}

/// Reads a required string.
pub(crate) fn read_text<'a>(
    field: &str,
    value: Option<&'a Value>,
    wanted: &str,
) -> Result<&'a str, ScenarioError> {
    match value {
        None => Err(ScenarioError::Missing { field: field.to_owned(), wanted: wanted.to_owned() }),
        Some(value) => value.as_str().ok_or_else(|| wrong_type(field, value, wanted)),
    }
}

/// Reads a finite number; −0.0 becomes 0.0.
pub(crate) fn read_number(field: &str, value: &Value) -> Result<f64, ScenarioError> {
    value
        .as_f64()
        .filter(|v| v.is_finite())
        .map(|v| v + 0.0)
        .ok_or_else(|| wrong_type(field, value, "a finite number"))
}

/// The error of a field with a value of the wrong type.
pub(crate) fn wrong_type(field: &str, value: &Value, wanted: &str) -> ScenarioError {
    ScenarioError::WrongType {
        field: field.to_owned(),
        found: shorten(&value.to_string(), MAX_QUOTED_CHARS),
        wanted: wanted.to_owned(),
    }
}
