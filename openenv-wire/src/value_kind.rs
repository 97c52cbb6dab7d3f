//! Kinds of the values in actions: how they are read, written and described.

use std::borrow::Cow;

use env_core::log::Precision;
use serde_json::{Value, json};

use crate::number::{NumberError, parse_number, parse_single};

/// Kind of the values of a world's actions.
#[derive(Debug, Clone, Copy)]
pub(crate) enum ValueKind {
    /// Numbers within a range.
    Number {
        /// Largest magnitude of a value; larger ones are clamped.
        bound: f64,
    },
    /// Names of actions, which stand for their indices. Readers accept indices, too.
    Name(&'static [&'static str]),
}

/// The reason why a value is invalid, in pydantic's words.
#[derive(Debug)]
pub(crate) struct ValueError {
    /// Kind of error in pydantic's vocabulary.
    pub(crate) kind: &'static str,
    /// Description of the value that was expected.
    pub(crate) msg: Cow<'static, str>,
    /// Words that `msg` contains, if any.
    pub(crate) ctx: Option<Value>,
}

impl From<NumberError> for ValueError {
    fn from(error: NumberError) -> Self {
        Self { kind: error.kind, msg: Cow::Borrowed(error.msg), ctx: None }
    }
}

impl ValueKind {
    /// Reads a value for a log of that precision.
    pub(crate) fn parse(self, value: &Value, precision: Precision) -> Result<f64, ValueError> {
        match self {
            Self::Number { .. } => Ok(match precision {
                Precision::F64 => parse_number(value)?,
                Precision::F32 => parse_single(value)?,
            }),
            Self::Name(names) => {
                let index = match value {
                    Value::String(text) => names.iter().position(|name| name == text),
                    Value::Number(number) => (0..names.len()).find(|i| number.as_f64() == Some(*i as f64)),
                    _ => None,
                };
                index.map(|index| index as f64).ok_or_else(|| unknown_name(names))
            }
        }
    }

    /// JSON Schema of a value that a writer intends.
    pub(crate) fn strict_schema(self, description: &Value) -> Value {
        match self {
            Self::Number { bound } => json!({
                "type": "number", "minimum": -bound, "maximum": bound, "description": description,
            }),
            Self::Name(names) => json!({"type": "string", "enum": names, "description": description}),
        }
    }

    /// Writes a value: a number clamped to its bounds as the environment would clamp it, or the name of an action.
    pub(crate) fn to_json(self, value: f64) -> Value {
        match self {
            Self::Number { bound } => json!(value.clamp(-bound, bound)),
            Self::Name(names) => {
                let name = names.iter().enumerate().find(|(index, _)| value == *index as f64);
                name.map_or_else(|| json!(value), |(_, name)| json!(name))
            }
        }
    }
}

/// The error of a value that is neither a name nor an index.
fn unknown_name(names: &[&str]) -> ValueError {
    let quoted: Vec<_> = names.iter().map(|name| format!("'{name}'")).collect();
    let expected = match quoted.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => String::new(),
    };
    ValueError {
        kind: "literal_error",
        msg: Cow::Owned(format!("Input should be {expected}")),
        ctx: Some(json!({"expected": expected})),
    }
}
