//! Columns of numbers as they come over the wire: lists in JSON and MessagePack, or packed bytes in MessagePack.

use std::fmt;

use serde::Deserialize;
use serde::de::{self, DeserializeOwned, IgnoredAny, SeqAccess, Visitor};

use super::extract::Form;
use super::problem::Problem;
use crate::leases::columns::MAX_COLUMN_GROUPS;

/// One number an episode.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column<T>(pub(super) Vec<T>);

impl<T> Default for Column<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

/// What a column can be of.
pub(super) trait Entry: Sized {
    /// Bytes of one, packed.
    const BYTES: usize;
    /// What one must be.
    const WANTED: &'static str;
    /// From a number.
    fn of(number: f64) -> Option<Self>;
    /// From packed bytes, of which there are enough.
    fn packed(bytes: &[u8]) -> Option<Self>;
}

impl Entry for f32 {
    const BYTES: usize = 4;
    const WANTED: &'static str = "a number";
    #[expect(clippy::cast_possible_truncation, reason = "columns are in single precision")]
    fn of(number: f64) -> Option<Self> {
        let single = number as Self;
        single.is_finite().then_some(single)
    }
    fn packed(bytes: &[u8]) -> Option<Self> {
        Some(Self::from_le_bytes(bytes.try_into().ok()?))
    }
}

impl Entry for u8 {
    const BYTES: usize = 1;
    const WANTED: &'static str = "0 or 1";
    fn of(number: f64) -> Option<Self> {
        u32::of(number).and_then(|whole| Self::try_from(whole).ok())
    }
    fn packed(bytes: &[u8]) -> Option<Self> {
        bytes.first().copied()
    }
}

impl Entry for u32 {
    const BYTES: usize = 4;
    const WANTED: &'static str = "a whole number from 0 to 4294967295";
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be one before")]
    fn of(number: f64) -> Option<Self> {
        let whole = number.fract() == 0.0 && (0.0..=f64::from(Self::MAX)).contains(&number);
        whole.then_some(number as Self)
    }
    fn packed(bytes: &[u8]) -> Option<Self> {
        Some(Self::from_le_bytes(bytes.try_into().ok()?))
    }
}

/// A whole number, or none.
pub(super) fn whole<'de, D: de::Deserializer<'de>>(reader: D) -> Result<Option<u32>, D::Error> {
    let number = Option::<Number>::deserialize(reader).map_err(|error| {
        let wanted = format!("it is not {}", u32::WANTED);
        // A fault of the text itself has a place in the text.
        if error.to_string().contains(NO_NUMBER) { de::Error::custom(wanted) } else { error }
    })?;
    let read = |Number(number): Number| {
        let wanted = || de::Error::custom(format!("it is {number}, but must be {}", u32::WANTED));
        u32::of(number).ok_or_else(wanted)
    };
    number.map(read).transpose()
}

/// Between the path of a field and what is wrong with it.
const MARK: &str = "\u{1}";

/// An error of a field, so that [`read`] finds its name again.
pub(super) fn within<E: de::Error>(field: &str, error: impl fmt::Display) -> E {
    let error = error.to_string();
    E::custom(match error.split_once(MARK) {
        Some((place, words)) => format!("{field}.{place}{MARK}{words}"),
        None => format!("{field}{MARK}{error}"),
    })
}

impl<'de, T: Entry> Deserialize<'de> for Column<T> {
    fn deserialize<D: de::Deserializer<'de>>(reader: D) -> Result<Self, D::Error> {
        reader.deserialize_any(Reader(std::marker::PhantomData))
    }
}

struct Reader<T>(std::marker::PhantomData<T>);

impl<'de, T: Entry> Visitor<'de> for Reader<T> {
    type Value = Column<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of numbers")
    }

    fn visit_unit<E>(self) -> Result<Column<T>, E> {
        Ok(Column(Vec::new()))
    }

    fn visit_none<E>(self) -> Result<Column<T>, E> {
        Ok(Column(Vec::new()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Column<T>, A::Error> {
        let most = MAX_COLUMN_GROUPS as usize;
        let mut column = Vec::with_capacity(items.size_hint().unwrap_or(0).min(most));
        loop {
            let at = column.len();
            let number = match items.next_element::<Number>() {
                Ok(Some(Number(number))) => number,
                Ok(None) => return Ok(Column(column)),
                // A fault of the text itself has a place in the text.
                Err(error) if error.to_string().contains(NO_NUMBER) => {
                    return Err(de::Error::custom(format!("{at}{MARK}it is not {}", T::WANTED)));
                }
                Err(error) => return Err(error),
            };
            if at == most {
                return Err(de::Error::custom(format!("it has more than {most} entries")));
            }
            let entry = T::of(number);
            column.push(entry.ok_or_else(|| {
                de::Error::custom(format!("{at}{MARK}it is {number}, but must be {}", T::WANTED))
            })?);
        }
    }

    fn visit_bytes<E: de::Error>(self, bytes: &[u8]) -> Result<Column<T>, E> {
        let (entries, left) = (bytes.len() / T::BYTES, bytes.len() % T::BYTES);
        if left != 0 {
            return Err(E::custom(format!("it has {} bytes, and an entry has {}", bytes.len(), T::BYTES)));
        }
        if entries > MAX_COLUMN_GROUPS as usize {
            return Err(E::custom(format!("it has more than {MAX_COLUMN_GROUPS} entries")));
        }
        Ok(Column(bytes.chunks_exact(T::BYTES).filter_map(T::packed).collect()))
    }

    fn visit_byte_buf<E: de::Error>(self, bytes: Vec<u8>) -> Result<Column<T>, E> {
        self.visit_bytes(&bytes)
    }
}

/// What a list has where a number is wanted.
const NO_NUMBER: &str = "\u{2}";

/// Any number.
struct Number(f64);

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: de::Deserializer<'de>>(reader: D) -> Result<Self, D::Error> {
        struct Any;
        impl Visitor<'_> for Any {
            type Value = Number;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(NO_NUMBER)
            }
            fn visit_f64<E>(self, number: f64) -> Result<Number, E> {
                Ok(Number(number))
            }
            #[expect(clippy::cast_precision_loss, reason = "whole numbers that fit a column are far smaller")]
            fn visit_u64<E>(self, number: u64) -> Result<Number, E> {
                Ok(Number(number as f64))
            }
            #[expect(clippy::cast_precision_loss, reason = "whole numbers that fit a column are far smaller")]
            fn visit_i64<E>(self, number: i64) -> Result<Number, E> {
                Ok(Number(number as f64))
            }
        }
        reader.deserialize_any(Any)
    }
}

/// Reads an object with columns.
pub(super) fn read<T: DeserializeOwned>(form: Form, body: &[u8]) -> Result<T, Problem> {
    let (told, unread) = match form {
        Form::Json => match serde_json::from_slice(body) {
            Ok(read) => return Ok(read),
            Err(error) => (error.to_string(), serde_json::from_slice::<IgnoredAny>(body).is_err()),
        },
        Form::MessagePack => match crate::input::from_messagepack(body) {
            Ok(read) => return Ok(read),
            Err(error) => (error.to_string(), crate::input::from_messagepack::<IgnoredAny>(body).is_err()),
        },
    };
    // What serde_json adds about lines and columns says nothing to whoever sent numbers.
    let words = told.split(" at line ").next().unwrap_or_default();
    match words.split_once(MARK) {
        _ if unread => Err(Problem::malformed(form, told.rsplit(MARK).next().unwrap_or_default())),
        Some((field, words)) => Err(Problem::invalid(field, plain(words))),
        None => Err(keys(words)),
    }
}

/// What is wrong with a column as a whole, in plain words.
fn plain(words: &str) -> &str {
    if words.starts_with("invalid type: ") { "it must be a list of numbers" } else { words }
}

/// What is wrong with the keys of an object, told as everywhere.
fn keys(words: &str) -> Problem {
    let named = |begin: &str| words.strip_prefix(begin)?.split_once('`');
    if let Some((name, known)) = named("unknown field `") {
        let known = known.trim_start_matches(", expected one of ").replace('`', "");
        let fault = crate::input::FieldError::unknown(name, &known);
        return Problem::invalid(fault.field, fault.reason);
    }
    match named("missing field `") {
        Some((name, _)) => Problem::invalid(name, "it is missing"),
        None => Problem::invalid("body", words),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[derive(Debug, Default, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Two {
        #[serde(deserialize_with = "score")]
        score: Column<f32>,
        #[serde(default, deserialize_with = "steps")]
        steps: Column<u32>,
    }

    fn score<'de, D: de::Deserializer<'de>>(reader: D) -> Result<Column<f32>, D::Error> {
        Column::deserialize(reader).map_err(|error| within("score", error))
    }

    fn steps<'de, D: de::Deserializer<'de>>(reader: D) -> Result<Column<u32>, D::Error> {
        Column::deserialize(reader).map_err(|error| within("steps", error))
    }

    fn packed(scores: &[f32], bin: bool) -> Vec<u8> {
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
        fn three_ways_to_write_a_column_are_one(scores in proptest::collection::vec(-2.0f32..2.0, 0..50)) {
            let wanted = Two { score: Column(scores.clone()), ..Two::default() };
            let json = serde_json::json!({"score": scores}).to_string();
            prop_assert_eq!(&read::<Two>(Form::Json, json.as_bytes()).unwrap(), &wanted);
            prop_assert_eq!(&read::<Two>(Form::MessagePack, &packed(&scores, false)).unwrap(), &wanted);
            prop_assert_eq!(&read::<Two>(Form::MessagePack, &packed(&scores, true)).unwrap(), &wanted);
        }

        #[test]
        fn no_bytes_panic(bytes: Vec<u8>, head in 0usize..12) {
            let framed = [&packed(&[0.5], false)[..head], &bytes].concat();
            for body in [&bytes, &framed] {
                let _ = read::<Two>(Form::MessagePack, body);
                let _ = read::<Two>(Form::Json, body);
            }
        }
    }

    #[test]
    fn what_is_wrong_is_told_by_its_place() {
        let told = |form, body: &[u8]| read::<Two>(form, body).unwrap_err().words();
        assert_eq!(
            told(Form::Json, br#"{"score": [1, 2], "steps": [1, 2.5]}"#),
            "steps.1: it is 2.5, but must be a whole number from 0 to 4294967295"
        );
        assert_eq!(told(Form::Json, br#"{"score": [1, "2"]}"#), "score.1: it is not a number");
        assert!(told(Form::Json, br#"{"score": [1, 2"#).contains("not JSON"));
        let mut cut = packed(&[0.5; 3], false);
        cut.truncate(cut.len() - 3);
        assert!(told(Form::MessagePack, &cut).contains("not MessagePack"));
    }
}
