//! Reading what others wrote, so that every refusal names the field at fault and says what it must be in plain words.
//!
//! Stricter than serde by itself: a key that is there twice is refused (the last would win), and so is a list where an
//! object is wanted (its places would be taken for fields).

mod fault;
mod once;
mod reader;

use serde::de::DeserializeOwned;
use serde_json::Value;

pub(crate) use self::fault::Fault;
pub(crate) use self::once::{Unread, packed, packed_value, value};
use self::reader::Reader;

/// A value as `T`.
///
/// # Errors
/// The field at fault.
pub(crate) fn read<T: DeserializeOwned>(value: Value) -> Result<T, Fault> {
    T::deserialize(Reader::new(value))
}

/// Pairs of words, as a query has them, as `T`: numbers, `true` and `false` are read from their words.
///
/// # Errors
/// The field at fault.
pub(crate) fn read_words<T: DeserializeOwned>(pairs: Vec<(String, String)>) -> Result<T, Fault> {
    let mut fields = serde_json::Map::new();
    for (name, word) in pairs {
        if fields.contains_key(&name) {
            return Err(Fault::twice(&name));
        }
        fields.insert(name, Value::String(word));
    }
    T::deserialize(Reader::of_words(fields))
}

#[cfg(test)]
mod tests;
