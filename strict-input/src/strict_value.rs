//! Parsers of JSON and MessagePack that reject duplicate keys and bound the number of values.

use std::cell::{Cell, RefCell};
use std::fmt;
use std::io::Cursor;

use serde::de::{self, DeserializeOwned, DeserializeSeed, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value, map::Entry};

use super::FieldError;

/// Maximum number of values in one body. A value takes 32 bytes of memory, but as little as one byte of the body.
pub(crate) const MAX_VALUES: usize = 4_000_000;
/// Maximum nesting of MessagePack; serde_json has the same bound for JSON.
const MAX_DEPTH: usize = 128;

/// Error of a body that cannot be parsed.
#[derive(Debug)]
pub enum InputError {
    /// The bytes are not JSON or not MessagePack; the parser's message.
    Malformed(String),
    /// An object has the same key twice.
    DuplicateKey(FieldError),
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Malformed(message) => f.write_str(message),
            Self::DuplicateKey(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for InputError {}

/// Parses JSON.
///
/// # Errors
/// Returns [`InputError::Malformed`] if the bytes are not one JSON value or hold too many values, and
/// [`InputError::DuplicateKey`] if an object has a key twice.
pub fn parse_json(bytes: &[u8]) -> Result<Value, InputError> {
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Err(InputError::Malformed("it is empty".to_owned()));
    }
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    parse_strictly(|seed| seed.deserialize(&mut reader).and_then(|value| reader.end().map(|()| value)))
}

/// Parses MessagePack.
///
/// # Errors
/// Returns [`InputError::Malformed`] if the bytes are not one MessagePack value, nest too deeply or hold too many values,
/// and [`InputError::DuplicateKey`] if a map has a key twice.
pub fn parse_messagepack(bytes: &[u8]) -> Result<Value, InputError> {
    let mut reader = messagepack_reader(bytes);
    parse_strictly(|seed| {
        seed.deserialize(&mut reader).and_then(|value| check_end(&reader, bytes).map(|()| value))
    })
}

/// Deserializes MessagePack as `T` without an intermediate value.
///
/// # Errors
/// Returns the decoder's error if the bytes are not MessagePack, do not fit `T`, or go on after the value.
pub fn from_messagepack<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, rmp_serde::decode::Error> {
    let mut reader = messagepack_reader(bytes);
    let value = T::deserialize(&mut reader)?;
    check_end(&reader, bytes).map(|()| value)
}

type MessagePackReader<'a> = rmp_serde::Deserializer<rmp_serde::decode::ReadReader<Cursor<&'a [u8]>>>;

fn messagepack_reader(bytes: &[u8]) -> MessagePackReader<'_> {
    let mut reader = rmp_serde::Deserializer::new(Cursor::new(bytes));
    reader.set_max_depth(MAX_DEPTH);
    reader
}

fn check_end(reader: &MessagePackReader<'_>, bytes: &[u8]) -> Result<(), rmp_serde::decode::Error> {
    if reader.position() == bytes.len() as u64 {
        Ok(())
    } else {
        Err(rmp_serde::decode::Error::Uncategorized("bytes follow its end".to_owned()))
    }
}

fn parse_strictly<E: fmt::Display>(
    parse: impl FnOnce(StrictValueSeed<'_>) -> Result<Value, E>,
) -> Result<Value, InputError> {
    let (duplicate, remaining) = (RefCell::new(None), Cell::new(MAX_VALUES));
    parse(StrictValueSeed { duplicate: &duplicate, remaining: &remaining }).map_err(|error| {
        match duplicate.into_inner() {
            Some(field) => InputError::DuplicateKey(field),
            None => InputError::Malformed(error.to_string()),
        }
    })
}

/// Serde seed of one value that rejects duplicate keys.
///
/// A duplicate key is stored in `duplicate`; each level that returns adds its name to the path.
#[derive(Clone, Copy)]
struct StrictValueSeed<'a> {
    duplicate: &'a RefCell<Option<FieldError>>,
    /// Number of values that the body may still hold.
    remaining: &'a Cell<usize>,
}

impl StrictValueSeed<'_> {
    /// Returns a mapper of errors that adds `name` to the path of a duplicate key.
    fn nest_in<E>(self, name: impl FnOnce() -> String) -> impl FnOnce(E) -> E {
        move |error| {
            let mut duplicate = self.duplicate.borrow_mut();
            *duplicate = duplicate.take().map(|field| field.nested_in(&name()));
            error
        }
    }
}

impl<'de> DeserializeSeed<'de> for StrictValueSeed<'_> {
    type Value = Value;

    fn deserialize<D: de::Deserializer<'de>>(self, reader: D) -> Result<Value, D::Error> {
        let remaining = self.remaining.get().checked_sub(1);
        self.remaining.set(remaining.ok_or_else(|| {
            de::Error::custom(format!("it has more than {MAX_VALUES} values; send less at a time"))
        })?);
        reader.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for StrictValueSeed<'_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<Value, E> {
        Number::from_f64(value).map(Value::Number).ok_or_else(|| E::custom("a number is not finite"))
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(Value::String(value.to_owned()))
    }

    fn visit_string<E>(self, value: String) -> Result<Value, E> {
        Ok(Value::String(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(item) =
            items.next_element_seed(self).map_err(self.nest_in(|| list.len().to_string()))?
        {
            list.push(item);
        }
        Ok(Value::Array(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut fields: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(name) = fields.next_key::<String>()? {
            match object.entry(name) {
                Entry::Vacant(entry) => {
                    let value = fields.next_value_seed(self);
                    let value = value.map_err(self.nest_in(|| entry.key().clone()))?;
                    entry.insert(value);
                }
                Entry::Occupied(entry) => {
                    *self.duplicate.borrow_mut() = Some(FieldError::duplicate(entry.key()));
                    return Err(de::Error::custom("an object has the same key twice"));
                }
            }
        }
        Ok(Value::Object(object))
    }
}
