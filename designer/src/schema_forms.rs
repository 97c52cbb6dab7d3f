//! JSON schemas that strict endpoints and grammars accept: every object is closed and requires all its fields, in order.

use serde_json::{Map, Value, json};

use crate::brief::ParamChoice;

/// Returns the schema of an object that requires all of these fields, in this order.
pub(crate) fn object(fields: &[(&str, Value)]) -> Value {
    let order: Vec<_> = fields.iter().map(|field| field.0).collect();
    let properties: Map<_, _> =
        fields.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    json!({"type": "object", "additionalProperties": false, "required": order, "properties": properties})
}

/// Returns the schema of an integer within bounds.
pub(crate) fn integer(min: impl Into<i64>, max: impl Into<i64>) -> Value {
    json!({"type": "integer", "minimum": min.into(), "maximum": max.into()})
}

/// Returns the schema of an integer within bounds, or null.
pub(crate) fn optional_integer(min: impl Into<i64>, max: impl Into<i64>) -> Value {
    json!({"anyOf": [integer(min, max), {"type": "null"}]})
}

/// Returns the schema of one of some strings.
pub(crate) fn string_of<'a>(choices: impl IntoIterator<Item = &'a str>) -> Value {
    json!({"type": "string", "enum": choices.into_iter().collect::<Vec<_>>()})
}

/// Returns the schema of the params that a design may choose; `None` if there are none.
pub(crate) fn params(choices: &[&ParamChoice]) -> Option<Value> {
    let params: Vec<_> = choices
        .iter()
        .map(|choice| (choice.param.as_str(), json!({"type": "number", "enum": choice.values})))
        .collect();
    (!params.is_empty()).then(|| object(&params))
}
