//! Reading JSON by hand, so that every error names its field.

use serde_json::{Map, Value};

use crate::error::ScenarioError;

pub(super) fn object<'a>(field: &str, value: &'a Value) -> Result<&'a Map<String, Value>, ScenarioError> {
    value.as_object().ok_or_else(|| wrong(field, value, "an object"))
}

pub(super) fn known(prefix: &str, fields: &Map<String, Value>, names: &[&str]) -> Result<(), ScenarioError> {
    match fields.keys().find(|key| !names.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => Err(ScenarioError::UnknownField {
            field: format!("{prefix}{}", shorten(key)),
            known: names.join(", "),
        }),
    }
}

pub(super) fn text<'a>(
    field: &str,
    value: Option<&'a Value>,
    wanted: &str,
) -> Result<&'a str, ScenarioError> {
    match value {
        None => Err(ScenarioError::Missing { field: field.to_owned(), wanted: wanted.to_owned() }),
        Some(value) => value.as_str().ok_or_else(|| wrong(field, value, wanted)),
    }
}

pub(super) fn number(field: &str, value: &Value) -> Result<f64, ScenarioError> {
    value
        .as_f64()
        .filter(|v| v.is_finite())
        .map(|v| v + 0.0)
        .ok_or_else(|| wrong(field, value, "a finite number"))
}

pub(super) fn wrong(field: &str, value: &Value, wanted: &str) -> ScenarioError {
    ScenarioError::WrongType {
        field: field.to_owned(),
        found: shorten(&value.to_string()),
        wanted: wanted.to_owned(),
    }
}

/// At most 60 characters of what a stranger wrote, for a message.
pub(super) fn shorten(text: &str) -> String {
    if text.chars().count() <= 60 {
        text.to_owned()
    } else {
        text.chars().take(57).chain("...".chars()).collect()
    }
}
