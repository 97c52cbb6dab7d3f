//! Parsing of the fields that the designs of all worlds have, and of their parts. Every error names its field and the values
//! that are allowed.

use std::collections::BTreeMap;

use env_core::format_shortest;
use serde_json::{Map, Value};

use crate::brief::{DesignBrief, ParamChoice};
use crate::field_error::FieldError;
use crate::untrusted_text::{is_control, shorten};

/// Maximum length of a layout's name, in characters.
pub(crate) const MAX_NAME_CHARS: usize = 60;
/// Maximum number of params that are parsed.
const MAX_PARAMS: usize = 40;

/// Returns the fields of an object; `field` is its path in errors.
pub(crate) fn parse_object<'a>(field: &str, value: &'a Value) -> Result<&'a Map<String, Value>, FieldError> {
    value.as_object().ok_or_else(|| FieldError::new(field, "must be an object"))
}

/// Rejects fields of the object at `path` that are not known.
pub(crate) fn reject_unknown(
    path: &str,
    fields: &Map<String, Value>,
    known: &[&str],
) -> Result<(), FieldError> {
    match fields.keys().find(|key| !known.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => Err(FieldError::new(
            format!("{path}.{}", shorten(key)),
            format!("is not a known field; the known fields are {}", known.join(", ")),
        )),
    }
}

/// Parses one of some names and returns its index.
pub(crate) fn parse_choice(field: &str, value: Option<&Value>, names: &[&str]) -> Result<usize, FieldError> {
    value
        .and_then(Value::as_str)
        .and_then(|given| names.iter().position(|name| *name == given))
        .ok_or_else(|| FieldError::new(field, format!("must be one of {}", names.join(", "))))
}

/// Parses the list of a design's parts with 1 to `max` entries. `parse` gets the path of an entry and its value.
pub(crate) fn parse_list<T>(
    field: &str,
    entry_name: &str,
    value: Option<&Value>,
    max: usize,
    parse: impl Fn(&str, &Value) -> Result<T, FieldError>,
) -> Result<Vec<T>, FieldError> {
    let list = value
        .and_then(Value::as_array)
        .ok_or_else(|| FieldError::new(field, format!("must be a list of {entry_name}")))?;
    if list.is_empty() || list.len() > max {
        let message = format!("must have 1 to {max} entries, got {}", list.len());
        return Err(FieldError::new(field, message));
    }
    list.iter().enumerate().map(|(i, value)| parse(&format!("{field}.{i}"), value)).collect()
}

/// Returns the name of a design; empty if it has none.
pub(crate) fn parse_name(fields: &Map<String, Value>) -> String {
    fields.get("name").and_then(Value::as_str).map_or_else(String::new, clean_name)
}

/// Parses the failure mode of an aim as text. [`check_mode`] checks it against a brief.
pub(crate) fn parse_mode(aim: &Map<String, Value>) -> Result<String, FieldError> {
    let mode = aim.get("mode").and_then(Value::as_str);
    mode.map(clean_name)
        .ok_or_else(|| FieldError::new("aim.mode", "is required: the failure mode that the layout aims at"))
}

/// Parses params as numbers. [`check_params`] checks them against a brief.
pub(crate) fn parse_params(value: Option<&Value>) -> Result<BTreeMap<String, f64>, FieldError> {
    let Some(value) = value.filter(|value| !value.is_null()) else { return Ok(BTreeMap::new()) };
    let param = |(name, value): (&String, &Value)| {
        let name = clean_name(name);
        match value.as_f64().filter(|number| number.is_finite()) {
            Some(number) => Ok((name, number)),
            None => Err(FieldError::new(format!("params.{name}"), "must be a number")),
        }
    };
    parse_object("params", value)?.iter().take(MAX_PARAMS).map(param).collect()
}

/// Checks that a failure mode is one of those that a brief allows.
pub(crate) fn check_mode(mode: &str, allowed: &[&str]) -> Result<(), FieldError> {
    if allowed.contains(&mode) {
        return Ok(());
    }
    let (known, mode) = (allowed.join(", "), shorten(mode));
    Err(FieldError::new("aim.mode", format!("must be one of {known} for this brief, got {mode:?}")))
}

/// Checks that each param has the value of the brief's recipe, or is one of `choices`.
pub(crate) fn check_params(
    params: &BTreeMap<String, f64>,
    brief: &DesignBrief,
    choices: &[&ParamChoice],
) -> Result<(), FieldError> {
    params.iter().try_for_each(|(name, value)| check_param(name, *value, brief, choices))
}

fn check_param(
    name: &str,
    value: f64,
    brief: &DesignBrief,
    choices: &[&ParamChoice],
) -> Result<(), FieldError> {
    if brief.recipe.param(name).is_some_and(|held| held.to_bits() == value.to_bits()) {
        return Ok(());
    }
    let field = format!("params.{name}");
    let Some(choice) = choices.iter().find(|choice| choice.param == *name) else {
        let known = choices.iter().map(|choice| choice.param.as_str()).collect::<Vec<_>>().join(", ");
        let message = if known.is_empty() {
            "must be left out: all params are fixed".to_owned()
        } else {
            format!("must be left out: a layout may set only {known}")
        };
        return Err(FieldError::new(field, message));
    };
    if choice.values.contains(&value) {
        return Ok(());
    }
    let values = choice.values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    Err(FieldError::new(field, format!("must be one of {values}, got {}", format_shortest(value))))
}

/// Returns untrusted text as a name: one line, at most [`MAX_NAME_CHARS`] characters.
fn clean_name(text: &str) -> String {
    let plain = text.chars().map(|c| if is_control(c) { ' ' } else { c });
    plain.take(MAX_NAME_CHARS).collect::<String>().trim().to_owned()
}
