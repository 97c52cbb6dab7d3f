//! Reads JSON bodies, MessagePack bodies, query strings and files that users wrote. Every error names the field at fault and
//! says in plain words which values are accepted.
//!
//! The reader is stricter than serde alone. It rejects a key that appears twice (serde would keep the last value) and a
//! list where an object is expected (serde would match its items to fields by position).
//!
//! Start reading at [`from_value`]. [`strict_value`] parses bytes into a JSON value, [`value_deserializer`] turns a value
//! into a Rust type, and [`field_error`] words the errors.

mod field_error;
mod input_error;
mod json_content;
mod json_tokens;
mod non_finite;
mod strict_value;
#[cfg(test)]
mod tests;
mod value_deserializer;

use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

pub use self::field_error::{FieldError, KNOWN_FIELDS};
pub use self::input_error::{InputError, InputLimits};
pub use self::json_content::JsonContent;
pub use self::non_finite::{BlankedText, NonFiniteLiteral, non_finite_literals};
pub use self::strict_value::{ParsedInput, from_messagepack, parse_json, parse_messagepack};
use self::value_deserializer::ValueDeserializer;

/// Deserializes a JSON value as `T`.
///
/// # Errors
/// Returns the first field that is missing, unknown or of the wrong type.
pub fn from_value<T: DeserializeOwned>(value: Value) -> Result<T, FieldError> {
    T::deserialize(ValueDeserializer::new(value))
}

/// Deserializes the name-value pairs of a query string as `T`; numbers, `true` and `false` are parsed from their text.
///
/// # Errors
/// Returns the first field that is missing, unknown, duplicated or of the wrong type.
pub fn from_query_pairs<T: DeserializeOwned>(pairs: Vec<(String, String)>) -> Result<T, FieldError> {
    let mut fields = Map::new();
    for (name, text) in pairs {
        if fields.contains_key(&name) {
            return Err(FieldError::duplicate(&name));
        }
        fields.insert(name, Value::String(text));
    }
    T::deserialize(ValueDeserializer::from_query(fields))
}
