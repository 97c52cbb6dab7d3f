//! JSON and MessagePack in which every key stands once, and no more than can be held.

use std::cell::{Cell, RefCell};
use std::fmt;
use std::io::Cursor;

use serde::de::{self, DeserializeOwned, DeserializeSeed, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value, map::Entry};

use super::Fault;

/// Bytes that cannot be read.
#[derive(Debug)]
pub(crate) enum Unread {
    /// They are not JSON, or not MessagePack: a sentence.
    Malformed(String),
    /// They are, but a key is there twice.
    Twice(Fault),
}

impl fmt::Display for Unread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Malformed(why) => f.write_str(why),
            Self::Twice(fault) => fault.fmt(f),
        }
    }
}

impl std::error::Error for Unread {}

/// Reads JSON.
///
/// # Errors
/// What is no JSON, or has a key twice.
pub(crate) fn value(bytes: &[u8]) -> Result<Value, Unread> {
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Err(Unread::Malformed("there is nothing in it".to_owned()));
    }
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    once(|once| once.deserialize(&mut reader).and_then(|value| reader.end().map(|()| value)))
}

/// Values that are read of one body: a value takes 32 bytes of memory, and may take one of the body.
pub(crate) const MOST_VALUES: usize = 4_000_000;
/// How deep MessagePack may be; JSON has the same bound of its reader's.
const MOST_DEEP: usize = 128;

/// Reads MessagePack.
///
/// # Errors
/// What is none, or has a key twice.
pub(crate) fn packed_value(bytes: &[u8]) -> Result<Value, Unread> {
    let mut reader = packed_reader(bytes);
    once(|once| once.deserialize(&mut reader).and_then(|value| at_its_end(&reader, bytes).map(|()| value)))
}

/// Reads MessagePack as `T`.
///
/// # Errors
/// What is none, or no `T`.
pub(crate) fn packed<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, rmp_serde::decode::Error> {
    let mut reader = packed_reader(bytes);
    let value = T::deserialize(&mut reader)?;
    at_its_end(&reader, bytes).map(|()| value)
}

type PackedReader<'a> = rmp_serde::Deserializer<rmp_serde::decode::ReadReader<Cursor<&'a [u8]>>>;

fn packed_reader(bytes: &[u8]) -> PackedReader<'_> {
    let mut reader = rmp_serde::Deserializer::new(Cursor::new(bytes));
    reader.set_max_depth(MOST_DEEP);
    reader
}

fn at_its_end(reader: &PackedReader<'_>, bytes: &[u8]) -> Result<(), rmp_serde::decode::Error> {
    if reader.position() == bytes.len() as u64 {
        Ok(())
    } else {
        Err(rmp_serde::decode::Error::Uncategorized("bytes follow its end".to_owned()))
    }
}

fn once<E: fmt::Display>(read: impl FnOnce(Once<'_>) -> Result<Value, E>) -> Result<Value, Unread> {
    let (found, left) = (RefCell::new(None), Cell::new(MOST_VALUES));
    read(Once { found: &found, left: &left }).map_err(|error| match found.into_inner() {
        Some(fault) => Unread::Twice(fault),
        None => Unread::Malformed(error.to_string()),
    })
}

/// Reads one value; a key that is there twice is left in `found`, its path growing on the way out.
#[derive(Clone, Copy)]
struct Once<'a> {
    found: &'a RefCell<Option<Fault>>,
    /// Values that may still come.
    left: &'a Cell<usize>,
}

impl Once<'_> {
    fn within<E>(self, name: impl FnOnce() -> String) -> impl FnOnce(E) -> E {
        move |error| {
            let mut found = self.found.borrow_mut();
            *found = found.take().map(|fault| fault.within(&name()));
            error
        }
    }
}

impl<'de> DeserializeSeed<'de> for Once<'_> {
    type Value = Value;

    fn deserialize<D: de::Deserializer<'de>>(self, reader: D) -> Result<Value, D::Error> {
        let left = self.left.get().checked_sub(1);
        self.left.set(left.ok_or_else(|| {
            de::Error::custom(format!("it holds more than {MOST_VALUES} values; send less at a time"))
        })?);
        reader.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Once<'_> {
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
            items.next_element_seed(self).map_err(self.within(|| list.len().to_string()))?
        {
            list.push(item);
        }
        Ok(Value::Array(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut fields: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(name) = fields.next_key::<String>()? {
            match object.entry(name) {
                Entry::Vacant(place) => {
                    let value = fields.next_value_seed(self);
                    let value = value.map_err(self.within(|| place.key().clone()))?;
                    place.insert(value);
                }
                Entry::Occupied(place) => {
                    *self.found.borrow_mut() = Some(Fault::twice(place.key()));
                    return Err(de::Error::custom("a key is there twice"));
                }
            }
        }
        Ok(Value::Object(object))
    }
}
