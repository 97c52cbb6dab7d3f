//! A serde deserializer of JSON values that accepts only objects as structs and adds the path to every error.

use serde::de::value::StringDeserializer;
use serde::de::{self, DeserializeSeed, Deserializer, Error as _, IntoDeserializer, Unexpected, Visitor};
use serde::forward_to_deserialize_any;
use serde_json::{Map, Value};

use super::FieldError;

/// Deserializer of one value.
pub(super) struct ValueDeserializer {
    value: Value,
    /// True if strings may stand for numbers, `true` and `false`, as in a query string.
    is_query: bool,
}

impl ValueDeserializer {
    pub(super) const fn new(value: Value) -> Self {
        Self { value, is_query: false }
    }

    /// Deserializer of the fields of a query string, which are all strings.
    pub(super) const fn from_query(fields: Map<String, Value>) -> Self {
        Self { value: Value::Object(fields), is_query: true }
    }

    fn wrong_type(&self, expected: &str) -> FieldError {
        let found = match &self.value {
            Value::Null => Unexpected::Unit,
            Value::Bool(value) => Unexpected::Bool(*value),
            Value::Number(number) => match (number.as_u64(), number.as_i64(), number.as_f64()) {
                (Some(number), ..) => Unexpected::Unsigned(number),
                (_, Some(number), _) => Unexpected::Signed(number),
                (.., number) => Unexpected::Float(number.unwrap_or(f64::NAN)),
            },
            Value::String(text) => Unexpected::Str(text),
            Value::Array(_) => Unexpected::Seq,
            Value::Object(_) => Unexpected::Map,
        };
        FieldError::invalid_type(found, &expected)
    }

    /// Parses the text of a number, `true` or `false` of a query string.
    fn parsed(mut self) -> Self {
        if let (true, Value::String(text)) = (self.is_query, &self.value)
            && let Ok(value @ (Value::Number(_) | Value::Bool(_))) = serde_json::from_str(text)
        {
            self.value = value;
        }
        self
    }
}

/// Implements the methods for numbers and booleans, which a query string has as text.
macro_rules! deserialize_parsed {
    ($($method:ident)*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldError> {
            self.parsed().deserialize_any(visitor)
        }
    )*};
}

impl<'de> Deserializer<'de> for ValueDeserializer {
    type Error = FieldError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldError> {
        match self.value {
            Value::Null => visitor.visit_unit(),
            Value::Bool(value) => visitor.visit_bool(value),
            Value::Number(number) => match (number.as_u64(), number.as_i64(), number.as_f64()) {
                (Some(number), ..) => visitor.visit_u64(number),
                (_, Some(number), _) => visitor.visit_i64(number),
                (.., number) => visitor.visit_f64(number.unwrap_or(f64::NAN)),
            },
            Value::String(text) => visitor.visit_string(text),
            Value::Array(items) => {
                visitor.visit_seq(ListAccess { items: items.into_iter(), index: 0, is_query: self.is_query })
            }
            Value::Object(fields) => visitor.visit_map(ObjectAccess::new(fields, self.is_query)),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldError> {
        if self.value.is_null() { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, FieldError> {
        match self.value {
            Value::Object(fields) => visitor.visit_map(ObjectAccess::new(fields, self.is_query)),
            _ => Err(self.wrong_type("a map")),
        }
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, FieldError> {
        self.deserialize_map(visitor)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, FieldError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, FieldError> {
        match self.value {
            Value::String(variant) => {
                let variant: StringDeserializer<FieldError> = variant.into_deserializer();
                visitor.visit_enum(variant)
            }
            _ => Err(self.wrong_type(&format!("one of {}", variants.join(", ")))),
        }
    }

    deserialize_parsed! {
        deserialize_bool deserialize_i8 deserialize_i16 deserialize_i32 deserialize_i64 deserialize_u8 deserialize_u16
        deserialize_u32 deserialize_u64 deserialize_f32 deserialize_f64
    }

    forward_to_deserialize_any! {
        i128 u128 char str string bytes byte_buf unit unit_struct seq tuple tuple_struct identifier ignored_any
    }
}

/// Access to the items of a list.
struct ListAccess {
    items: std::vec::IntoIter<Value>,
    /// Index of the next item.
    index: usize,
    is_query: bool,
}

impl<'de> de::SeqAccess<'de> for ListAccess {
    type Error = FieldError;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, FieldError> {
        let Some(value) = self.items.next() else { return Ok(None) };
        let item = seed.deserialize(ValueDeserializer { value, is_query: self.is_query });
        let index = self.index;
        self.index += 1;
        item.map(Some).map_err(|error| error.nested_in(&index.to_string()))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.items.len())
    }
}

/// Access to the fields of an object.
struct ObjectAccess {
    fields: serde_json::map::IntoIter,
    /// Field whose key was deserialized and whose value comes next.
    pending: Option<(String, Value)>,
    is_query: bool,
}

impl ObjectAccess {
    fn new(fields: Map<String, Value>, is_query: bool) -> Self {
        Self { fields: fields.into_iter(), pending: None, is_query }
    }
}

impl<'de> de::MapAccess<'de> for ObjectAccess {
    type Error = FieldError;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, FieldError> {
        let Some((name, value)) = self.fields.next() else { return Ok(None) };
        let key: StringDeserializer<FieldError> = name.clone().into_deserializer();
        let key = seed.deserialize(key);
        self.pending = Some((name, value));
        key.map(Some)
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, FieldError> {
        let (name, value) = self.pending.take().unwrap_or_default();
        let value = seed.deserialize(ValueDeserializer { value, is_query: self.is_query });
        value.map_err(|error| error.nested_in(&name))
    }
}
