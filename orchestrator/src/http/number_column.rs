//! Columns of numbers in requests: lists in JSON and MessagePack, or packed little-endian bytes in MessagePack.

use std::fmt;

use env_core::format_shortest;
use env_core::text::shorten;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, DeserializeOwned, IgnoredAny, MapAccess, SeqAccess, Visitor};

use super::extract::BodyFormat;
use super::problem::{MAX_REPEATED_CHARS, Problem};
use crate::leases::columns::MAX_COLUMN_GROUPS;
use strict_input::BlankedText;

/// Column with one number for each episode.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct NumberColumn<T>(pub(super) Vec<T>);

impl<T> Default for NumberColumn<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

/// Type of a column's entries.
pub(super) trait ColumnEntry: Sized {
    /// Size of a packed entry in bytes.
    const BYTES: usize;
    /// Description of a valid entry, for errors.
    const EXPECTED: &'static str;
    /// Converts a number, if it is valid.
    fn from_number(number: f64) -> Option<Self>;
    /// Reads a packed entry from exactly [`Self::BYTES`] bytes.
    fn from_packed(bytes: &[u8]) -> Option<Self>;
}

impl ColumnEntry for f32 {
    const BYTES: usize = 4;
    const EXPECTED: &'static str = "a finite number";
    #[expect(clippy::cast_possible_truncation, reason = "columns are in single precision")]
    fn from_number(number: f64) -> Option<Self> {
        let single = number as Self;
        single.is_finite().then_some(single)
    }
    fn from_packed(bytes: &[u8]) -> Option<Self> {
        Some(Self::from_le_bytes(bytes.try_into().ok()?))
    }
}

impl ColumnEntry for u8 {
    const BYTES: usize = 1;
    const EXPECTED: &'static str = "0 or 1";
    fn from_number(number: f64) -> Option<Self> {
        u32::from_number(number).and_then(|whole| Self::try_from(whole).ok())
    }
    fn from_packed(bytes: &[u8]) -> Option<Self> {
        bytes.first().copied()
    }
}

impl ColumnEntry for u32 {
    const BYTES: usize = 4;
    const EXPECTED: &'static str = "an integer from 0 to 4294967295";
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the range is checked before"
    )]
    fn from_number(number: f64) -> Option<Self> {
        let whole = number.fract() == 0.0 && (0.0..=f64::from(Self::MAX)).contains(&number);
        whole.then_some(number as Self)
    }
    fn from_packed(bytes: &[u8]) -> Option<Self> {
        Some(Self::from_le_bytes(bytes.try_into().ok()?))
    }
}

/// Deserializes an optional `u32`.
pub(super) fn optional_u32<'de, D: de::Deserializer<'de>>(reader: D) -> Result<Option<u32>, D::Error> {
    let number = Option::<JsonNumber>::deserialize(reader).map_err(|error| {
        let expected = format!("must be {}", u32::EXPECTED);
        // A syntax error keeps its message, which names its place in the text.
        if error.to_string().contains(NOT_A_NUMBER) { de::Error::custom(expected) } else { error }
    })?;
    let convert = |JsonNumber(number): JsonNumber| {
        let invalid =
            || de::Error::custom(format!("must be {}, got {}", u32::EXPECTED, format_shortest(number)));
        u32::from_number(number).ok_or_else(invalid)
    };
    number.map(convert).transpose()
}

/// Separator between the path of a field and the message, inside the text of a serde error.
const PATH_SEPARATOR: &str = "\u{1}";

/// Adds the name of a field to an error, so that [`parse_columns`] can report it.
pub(super) fn field_error<E: de::Error>(field: &str, error: impl fmt::Display) -> E {
    let error = error.to_string();
    E::custom(match error.split_once(PATH_SEPARATOR) {
        Some((path, message)) => format!("{field}.{path}{PATH_SEPARATOR}{message}"),
        None => format!("{field}{PATH_SEPARATOR}{error}"),
    })
}

impl<'de, T: ColumnEntry> Deserialize<'de> for NumberColumn<T> {
    fn deserialize<D: de::Deserializer<'de>>(reader: D) -> Result<Self, D::Error> {
        reader.deserialize_any(ColumnVisitor(std::marker::PhantomData))
    }
}

struct ColumnVisitor<T>(std::marker::PhantomData<T>);

impl<'de, T: ColumnEntry> Visitor<'de> for ColumnVisitor<T> {
    type Value = NumberColumn<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of numbers")
    }

    fn visit_unit<E>(self) -> Result<NumberColumn<T>, E> {
        Ok(NumberColumn(Vec::new()))
    }

    fn visit_none<E>(self) -> Result<NumberColumn<T>, E> {
        Ok(NumberColumn(Vec::new()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<NumberColumn<T>, A::Error> {
        let max = MAX_COLUMN_GROUPS as usize;
        let mut column = Vec::with_capacity(items.size_hint().unwrap_or(0).min(max));
        loop {
            let at = column.len();
            let number = match items.next_element::<JsonNumber>() {
                Ok(Some(JsonNumber(number))) => number,
                Ok(None) => return Ok(NumberColumn(column)),
                // A syntax error keeps its message, which names its place in the text.
                Err(error) if error.to_string().contains(NOT_A_NUMBER) => {
                    return Err(de::Error::custom(format!("{at}{PATH_SEPARATOR}must be {}", T::EXPECTED)));
                }
                Err(error) => return Err(error),
            };
            if at == max {
                return Err(de::Error::custom(format!("must have at most {max} entries")));
            }
            let entry = T::from_number(number);
            column.push(entry.ok_or_else(|| {
                let number = format_shortest(number);
                de::Error::custom(format!("{at}{PATH_SEPARATOR}must be {}, got {number}", T::EXPECTED))
            })?);
        }
    }

    fn visit_bytes<E: de::Error>(self, bytes: &[u8]) -> Result<NumberColumn<T>, E> {
        let entries = bytes.len() / T::BYTES;
        if !bytes.len().is_multiple_of(T::BYTES) {
            return Err(E::custom(format!(
                "must have {} bytes for each entry, got {} bytes",
                T::BYTES,
                bytes.len()
            )));
        }
        if entries > MAX_COLUMN_GROUPS as usize {
            return Err(E::custom(format!("must have at most {MAX_COLUMN_GROUPS} entries")));
        }
        Ok(NumberColumn(bytes.chunks_exact(T::BYTES).filter_map(T::from_packed).collect()))
    }

    fn visit_byte_buf<E: de::Error>(self, bytes: Vec<u8>) -> Result<NumberColumn<T>, E> {
        self.visit_bytes(&bytes)
    }
}

/// Expectation of [`JsonNumber`], which marks its errors.
const NOT_A_NUMBER: &str = "\u{2}";

/// Number of any JSON or MessagePack type.
struct JsonNumber(f64);

impl<'de> Deserialize<'de> for JsonNumber {
    fn deserialize<D: de::Deserializer<'de>>(reader: D) -> Result<Self, D::Error> {
        struct NumberVisitor;
        impl Visitor<'_> for NumberVisitor {
            type Value = JsonNumber;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(NOT_A_NUMBER)
            }
            fn visit_f64<E>(self, number: f64) -> Result<JsonNumber, E> {
                Ok(JsonNumber(number))
            }
            #[expect(clippy::cast_precision_loss, reason = "integers that fit a column are far smaller")]
            fn visit_u64<E>(self, number: u64) -> Result<JsonNumber, E> {
                Ok(JsonNumber(number as f64))
            }
            #[expect(clippy::cast_precision_loss, reason = "integers that fit a column are far smaller")]
            fn visit_i64<E>(self, number: i64) -> Result<JsonNumber, E> {
                Ok(JsonNumber(number as f64))
            }
        }
        reader.deserialize_any(NumberVisitor)
    }
}

/// Value that is an object. serde alone also accepts a list and matches its items to fields by position.
struct StrictObject<T>(T);

impl<'de, T: Deserialize<'de>> Deserialize<'de> for StrictObject<T> {
    fn deserialize<D: de::Deserializer<'de>>(reader: D) -> Result<Self, D::Error> {
        struct ObjectVisitor<T>(std::marker::PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for ObjectVisitor<T> {
            type Value = StrictObject<T>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object with columns")
            }
            fn visit_map<A: MapAccess<'de>>(self, fields: A) -> Result<StrictObject<T>, A::Error> {
                T::deserialize(MapAccessDeserializer::new(fields)).map(StrictObject)
            }
        }
        reader.deserialize_map(ObjectVisitor(std::marker::PhantomData))
    }
}

/// Parses an object with columns. Errors name the field, and the entry if one is wrong.
pub(super) fn parse_columns<T: DeserializeOwned>(format: BodyFormat, body: &[u8]) -> Result<T, Problem> {
    let parsed = match format {
        BodyFormat::Json => parse_json_columns(body),
        BodyFormat::MessagePack => strict_input::from_messagepack(body).map_err(|error| InvalidColumns {
            message: error.to_string(),
            is_malformed: strict_input::from_messagepack::<IgnoredAny>(body).is_err(),
        }),
    };
    let InvalidColumns { message, is_malformed } = match parsed {
        Ok(StrictObject(value)) => return Ok(value),
        Err(invalid) => invalid,
    };
    // serde_json appends the line and column of the text, which does not help a client that sends numbers.
    let reason = message.split(" at line ").next().unwrap_or_default();
    match reason.split_once(PATH_SEPARATOR) {
        _ if is_malformed => {
            Err(Problem::malformed(format, message.rsplit(PATH_SEPARATOR).next().unwrap_or_default()))
        }
        Some((field, reason)) => Err(Problem::invalid(field, column_reason(reason))),
        None => Err(key_problem(reason)),
    }
}

/// Reason why bytes are not columns.
struct InvalidColumns {
    /// The parser's message, in which the field comes before [`PATH_SEPARATOR`].
    message: String,
    /// True if the bytes are not in their format.
    is_malformed: bool,
}

/// Parses columns in JSON. A number that is not finite, which JSON does not have, is an error of its entry.
fn parse_json_columns<T: DeserializeOwned>(text: &[u8]) -> Result<StrictObject<T>, InvalidColumns> {
    let parse = |text: &[u8]| {
        serde_json::from_slice(text).map_err(|error| InvalidColumns {
            message: error.to_string(),
            is_malformed: serde_json::from_slice::<IgnoredAny>(text).is_err(),
        })
    };
    parse(text).map_err(|invalid| {
        let blanked = BlankedText::new(text, MAX_COLUMN_GROUPS as usize);
        blanked.and_then(|blanked| parse(&blanked.text).err()).unwrap_or(invalid)
    })
}

/// Replaces serde's message about a value that is not a column.
fn column_reason(reason: &str) -> &str {
    if reason.starts_with("invalid type: ") { "must be a list of numbers" } else { reason }
}

/// Converts serde's message about the keys of an object to the problem that other requests return.
fn key_problem(reason: &str) -> Problem {
    let quoted = |prefix: &str| reason.strip_prefix(prefix)?.split_once('`');
    if let Some((name, known)) = quoted("unknown field `") {
        let known = known.trim_start_matches(", expected one of ").replace('`', "");
        let fault = strict_input::FieldError::unknown(name, &known);
        return Problem::invalid(fault.field, fault.reason);
    }
    match quoted("missing field `") {
        Some((name, _)) => Problem::invalid(name, "is required"),
        None => Problem::invalid("body", shorten(reason, MAX_REPEATED_CHARS)),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[derive(Debug, Default, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct TestColumns {
        #[serde(deserialize_with = "score")]
        score: NumberColumn<f32>,
        #[serde(default, deserialize_with = "steps")]
        steps: NumberColumn<u32>,
    }

    fn score<'de, D: de::Deserializer<'de>>(reader: D) -> Result<NumberColumn<f32>, D::Error> {
        NumberColumn::deserialize(reader).map_err(|error| field_error("score", error))
    }

    fn steps<'de, D: de::Deserializer<'de>>(reader: D) -> Result<NumberColumn<u32>, D::Error> {
        NumberColumn::deserialize(reader).map_err(|error| field_error("steps", error))
    }

    fn messagepack_body(scores: &[f32], bin: bool) -> Vec<u8> {
        let mut body = b"\x81\xa5score".to_vec();
        let count = scores.len() as u32;
        if bin {
            body.push(0xc6);
            body.extend((4 * count).to_be_bytes());
            scores.iter().for_each(|score| body.extend(score.to_le_bytes()));
        } else {
            body.push(0xdd);
            body.extend(count.to_be_bytes());
            for score in scores {
                body.push(0xca);
                body.extend(score.to_be_bytes());
            }
        }
        body
    }

    proptest! {
        #[test]
        fn all_encodings_of_a_column_are_equal(scores in proptest::collection::vec(-2.0f32..2.0, 0..50)) {
            let expected = TestColumns { score: NumberColumn(scores.clone()), ..TestColumns::default() };
            let json = serde_json::json!({"score": scores}).to_string();
            prop_assert_eq!(&parse_columns::<TestColumns>(BodyFormat::Json, json.as_bytes()).unwrap(), &expected);
            prop_assert_eq!(&parse_columns::<TestColumns>(BodyFormat::MessagePack, &messagepack_body(&scores, false)).unwrap(), &expected);
            prop_assert_eq!(&parse_columns::<TestColumns>(BodyFormat::MessagePack, &messagepack_body(&scores, true)).unwrap(), &expected);
        }

        #[test]
        fn arbitrary_bytes_do_not_panic(bytes: Vec<u8>, head in 0usize..12) {
            let framed = [&messagepack_body(&[0.5], false)[..head], &bytes].concat();
            for body in [&bytes, &framed] {
                let _ = parse_columns::<TestColumns>(BodyFormat::MessagePack, body);
                let _ = parse_columns::<TestColumns>(BodyFormat::Json, body);
            }
        }
    }

    #[test]
    fn errors_name_the_field_and_entry() {
        let message = |format, body: &[u8]| parse_columns::<TestColumns>(format, body).unwrap_err().message();
        assert_eq!(
            message(BodyFormat::Json, br#"{"score": [1, 2], "steps": [1, 2.5]}"#),
            "steps.1: must be an integer from 0 to 4294967295, got 2.5"
        );
        assert_eq!(message(BodyFormat::Json, br#"{"score": [1, "2"]}"#), "score.1: must be a finite number");
        for number in ["NaN", "-Infinity", "1e999"] {
            let text = format!(r#"{{"score": [1, {number}, {number}]}}"#);
            let expected = "score.1: must be a finite number";
            assert_eq!(message(BodyFormat::Json, text.as_bytes()), expected, "{number}");
        }
        assert!(message(BodyFormat::Json, br#"{"score": [NaN, 2"#).contains("not JSON"));
        assert!(message(BodyFormat::Json, br#"{"score": [1, 2"#).contains("not JSON"));
        let long = format!("\"{}\"", "x".repeat(100_000));
        assert!(message(BodyFormat::Json, long.as_bytes()).len() < 1000, "the error repeats the body");
        for (format, list) in
            [(BodyFormat::Json, &b"[[1, 2], [3]]"[..]), (BodyFormat::MessagePack, b"\x92\x91\x01\x91\x01")]
        {
            assert!(message(format, list).contains("an object with columns"), "{}", message(format, list));
        }
        let mut cut = messagepack_body(&[0.5; 3], false);
        cut.truncate(cut.len() - 3);
        assert!(message(BodyFormat::MessagePack, &cut).contains("not MessagePack"));
    }
}
