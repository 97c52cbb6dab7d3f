//! Parsers of JSON and MessagePack that reject duplicate keys and bound the numbers of values and of keys.

use std::cell::{Cell, RefCell};
use std::fmt;
use std::io::Cursor;

use env_core::format_shortest;
use serde::de::{self, DeserializeOwned, DeserializeSeed, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value, map::Entry};

use super::FieldError;
use super::input_error::{ContentKind, InputError, InputLimits};
use super::json_content::JsonContent;
use super::non_finite::{BlankedText, NonFiniteLiteral, non_finite_literals};

/// Maximum nesting of MessagePack; serde_json has the same bound for JSON.
const MAX_DEPTH: usize = 128;
/// Maximum number of fields that [`ParsedInput::non_finite`] lists.
const MAX_NON_FINITE: usize = 10_000;

/// Parses JSON. A number beyond the range of a double, such as `1e999`, and the words `NaN`, `Infinity` and `-Infinity` are
/// listed as numbers that are not finite.
///
/// # Errors
/// Returns [`InputError::Malformed`] if the bytes are not one JSON value or have more than 10 000 numbers that are not finite,
/// [`InputError::TooLarge`] if they exceed `limits`, and [`InputError::Field`] if an object has a key twice.
pub fn parse_json(bytes: &[u8], limits: InputLimits) -> Result<ParsedInput, InputError> {
    if bytes.iter().all(u8::is_ascii_whitespace) {
        return Err(InputError::Malformed("it is empty".to_owned()));
    }
    JsonContent::check_text(bytes, limits)?;
    let error = match parse_json_text(bytes, limits, Vec::new()) {
        Err(InputError::Malformed(error)) => error,
        outcome => return outcome,
    };
    // serde_json rejects the whole text for such a number and does not name its field.
    let Some(BlankedText { text, literals }) = BlankedText::new(bytes, MAX_NON_FINITE) else {
        let is_too_many = non_finite_literals(bytes).nth(MAX_NON_FINITE).is_some();
        return Err(InputError::Malformed(if is_too_many { too_many_non_finite() } else { error }));
    };
    let count = literals.len();
    let parsed = parse_json_text(&text, limits, literals)?;
    // The rest is in place of a key.
    if parsed.non_finite.len() == count { Ok(parsed) } else { Err(InputError::Malformed(error)) }
}

fn too_many_non_finite() -> String {
    format!("it has more than {MAX_NON_FINITE} numbers that are not finite")
}

/// Parses a text in which empty strings stand for `literals`.
fn parse_json_text(
    text: &[u8],
    limits: InputLimits,
    literals: Vec<NonFiniteLiteral>,
) -> Result<ParsedInput, InputError> {
    let mut reader = serde_json::Deserializer::from_slice(text);
    let state = ParserState::new(limits, literals);
    let parsed = StrictValueSeed(&state).deserialize(&mut reader);
    let parsed = parsed.and_then(|value| reader.end().map(|()| value));
    state.into_result(parsed)
}

/// Input as a JSON value.
#[derive(Debug, PartialEq)]
pub struct ParsedInput {
    /// The value, with null in place of each number that is not finite.
    pub value: Value,
    /// Errors of the numbers that are not finite, in their order.
    pub non_finite: Vec<FieldError>,
}

impl ParsedInput {
    /// Returns the value of an input whose numbers are all finite.
    ///
    /// # Errors
    /// Returns [`InputError::Field`] for the first number that is not finite.
    pub fn finite(self) -> Result<Value, InputError> {
        self.non_finite.into_iter().next().map_or(Ok(self.value), |error| Err(InputError::Field(error)))
    }
}

/// Parses MessagePack.
///
/// # Errors
/// Returns [`InputError::Malformed`] if the bytes are not one MessagePack value, nest too deeply or have more than 10 000
/// numbers that are not finite, [`InputError::TooLarge`] if they exceed `limits`, and [`InputError::Field`] if a map has a key
/// twice.
pub fn parse_messagepack(bytes: &[u8], limits: InputLimits) -> Result<ParsedInput, InputError> {
    let mut reader = messagepack_reader(bytes);
    let state = ParserState::new(limits, Vec::new());
    let parsed = StrictValueSeed(&state).deserialize(&mut reader);
    let parsed = parsed.and_then(|value| check_end(&reader, bytes).map(|()| value));
    state.into_result(parsed)
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

/// Shared state of the seeds of one input.
///
/// A level that returns adds its name to the path of each error that a value below it stored.
struct ParserState {
    limits: InputLimits,
    /// Number of values so far.
    values: Cell<usize>,
    /// Number of keys so far.
    keys: Cell<usize>,
    duplicate: RefCell<Option<FieldError>>,
    /// Limit that the input exceeds.
    exceeded: Cell<Option<ContentKind>>,
    /// Numbers for which empty strings stand in the text, in their order.
    literals: Vec<NonFiniteLiteral>,
    non_finite: RefCell<Vec<FieldError>>,
    /// Length of `non_finite`, which is read for every value.
    non_finite_count: Cell<usize>,
}

impl ParserState {
    fn new(limits: InputLimits, literals: Vec<NonFiniteLiteral>) -> Self {
        Self {
            limits,
            literals,
            values: Cell::new(0),
            keys: Cell::new(0),
            duplicate: RefCell::default(),
            exceeded: Cell::new(None),
            non_finite: RefCell::default(),
            non_finite_count: Cell::new(0),
        }
    }

    /// Returns the parsed input, or the reason why parsing failed.
    fn into_result(self, parsed: Result<Value, impl fmt::Display>) -> Result<ParsedInput, InputError> {
        match (parsed, self.duplicate.into_inner(), self.exceeded.get()) {
            (Ok(value), ..) => Ok(ParsedInput { value, non_finite: self.non_finite.into_inner() }),
            (Err(_), Some(field), _) => Err(InputError::Field(field)),
            (Err(_), None, Some(kind)) => Err(self.limits.error(kind)),
            (Err(error), None, None) => Err(InputError::Malformed(error.to_string())),
        }
    }

    /// Stores the error of a number that is not finite, and returns null in place of the number.
    fn reject_non_finite<E: de::Error>(&self, number: &str) -> Result<Value, E> {
        let mut non_finite = self.non_finite.borrow_mut();
        if non_finite.len() == MAX_NON_FINITE {
            return Err(E::custom(too_many_non_finite()));
        }
        non_finite.push(FieldError::not_finite(number));
        self.non_finite_count.set(non_finite.len());
        Ok(Value::Null)
    }

    /// Counts one value or key.
    fn count<E: de::Error>(&self, count: &Cell<usize>, limit: usize, kind: ContentKind) -> Result<(), E> {
        count.set(count.get() + 1);
        if count.get() <= limit {
            return Ok(());
        }
        self.exceeded.set(Some(kind));
        Err(E::custom("the input exceeds its limits"))
    }

    /// Adds `name` to the path of a duplicate key.
    fn nest_duplicate(&self, name: impl FnOnce() -> String) {
        let mut duplicate = self.duplicate.borrow_mut();
        *duplicate = duplicate.take().map(|field| field.nested_in(&name()));
    }

    /// Adds `name` to the paths of the numbers that are not finite, from the one at index `first` on.
    fn nest_non_finite(&self, first: usize, name: impl Fn() -> String) {
        if self.non_finite_count.get() == first {
            return;
        }
        for field in &mut self.non_finite.borrow_mut()[first..] {
            *field = std::mem::take(field).nested_in(&name());
        }
    }
}

/// Serde seed of one value.
#[derive(Clone, Copy)]
struct StrictValueSeed<'a>(&'a ParserState);

impl<'de> DeserializeSeed<'de> for StrictValueSeed<'_> {
    type Value = Value;

    fn deserialize<D: de::Deserializer<'de>>(self, reader: D) -> Result<Value, D::Error> {
        self.0.count(&self.0.values, self.0.limits.values, ContentKind::Values)?;
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
        match Number::from_f64(value) {
            Some(number) => Ok(Value::Number(number)),
            None => self.0.reject_non_finite(&format_shortest(value)),
        }
    }

    fn visit_str<E: de::Error>(self, value: &str) -> Result<Value, E> {
        let next = self.0.literals.get(self.0.non_finite_count.get());
        match next.filter(|literal| literal.value == self.0.values.get()) {
            Some(literal) => self.0.reject_non_finite(&literal.text),
            None => Ok(Value::String(value.to_owned())),
        }
    }

    fn visit_string<E>(self, value: String) -> Result<Value, E> {
        Ok(Value::String(value))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        loop {
            let (before, index) = (self.0.non_finite_count.get(), list.len());
            let item =
                items.next_element_seed(self).inspect_err(|_| self.0.nest_duplicate(|| index.to_string()))?;
            self.0.nest_non_finite(before, || index.to_string());
            match item {
                Some(item) => list.push(item),
                None => return Ok(Value::Array(list)),
            }
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, mut fields: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(name) = fields.next_key::<String>()? {
            self.0.count(&self.0.keys, self.0.limits.keys, ContentKind::Keys)?;
            match object.entry(name) {
                Entry::Vacant(entry) => {
                    let before = self.0.non_finite_count.get();
                    let value = fields.next_value_seed(self);
                    let value = value.inspect_err(|_| self.0.nest_duplicate(|| entry.key().clone()))?;
                    self.0.nest_non_finite(before, || entry.key().clone());
                    entry.insert(value);
                }
                Entry::Occupied(entry) => {
                    *self.0.duplicate.borrow_mut() = Some(FieldError::duplicate(entry.key()));
                    return Err(de::Error::custom("an object has the same key twice"));
                }
            }
        }
        Ok(Value::Object(object))
    }
}
