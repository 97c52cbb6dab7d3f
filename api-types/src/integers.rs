//! Deserializers of integers with a range. Their errors name the range, also for a value that is not an integer.
//!
//! They accept every value of the type. The server checks the range, so that a value out of range and a value of the wrong
//! type are different problems with the same text.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserializer, Error, Unexpected, Visitor};

/// Deserializes an optional integer from `MIN` to `MAX`.
pub(crate) fn optional<'de, D: Deserializer<'de>, const MIN: u32, const MAX: u32>(
    deserializer: D,
) -> Result<Option<u32>, D::Error> {
    deserializer.deserialize_option(Optional(PhantomData, format_args!("an integer from {MIN} to {MAX}")))
}

/// Deserializes an integer from `MIN` to `MAX`.
pub(crate) fn required<'de, D: Deserializer<'de>, const MIN: u32, const MAX: u32>(
    deserializer: D,
) -> Result<u32, D::Error> {
    deserializer.deserialize_u32(Integer(PhantomData, format_args!("an integer from {MIN} to {MAX}")))
}

/// Deserializes the number of groups of a lease, whose range depends on the form of the lease.
pub(crate) fn lease_groups<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    let expected = format_args!("an integer from 1 to 1024, or to 100000 with `form: columns`");
    deserializer.deserialize_u32(Integer(PhantomData, expected))
}

/// Deserializes the seed of a run, from 0 to 2^51 − 1.
pub(crate) fn optional_seed<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u64>, D::Error> {
    let expected = format_args!(
        "an integer from 0 to 2251799813685247 (larger seeds are reserved for training and evaluation)"
    );
    deserializer.deserialize_option(Optional(PhantomData, expected))
}

/// Deserializes the step of a trainer, from 0 to 2^53 − 1.
pub(crate) fn trainer_step<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
    deserializer.deserialize_u64(Integer(PhantomData, format_args!("an integer from 0 to 9007199254740991")))
}

/// Visitor of an integer, with the description of a valid one.
struct Integer<'a, T>(PhantomData<T>, fmt::Arguments<'a>);

impl<T: TryFrom<u64>> Visitor<'_> for Integer<'_, T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_fmt(self.1)
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<T, E> {
        T::try_from(number).map_err(|_| E::invalid_value(Unexpected::Unsigned(number), &self))
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<T, E> {
        let whole = u64::try_from(number).ok().and_then(|number| T::try_from(number).ok());
        whole.ok_or_else(|| E::invalid_value(Unexpected::Signed(number), &self))
    }
}

/// Visitor of an integer or null.
struct Optional<'a, T>(PhantomData<T>, fmt::Arguments<'a>);

impl<'de, T: TryFrom<u64>> Visitor<'de> for Optional<'_, T> {
    type Value = Option<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_fmt(self.1)
    }

    fn visit_none<E: Error>(self) -> Result<Option<T>, E> {
        Ok(None)
    }

    fn visit_unit<E: Error>(self) -> Result<Option<T>, E> {
        Ok(None)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Option<T>, D::Error> {
        deserializer.deserialize_u64(Integer(PhantomData, self.1)).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    struct Request {
        #[serde(default, deserialize_with = "super::optional::<_, 1, 500>")]
        limit: Option<u32>,
        #[serde(deserialize_with = "super::required::<_, 1, 86_400>")]
        ttl_s: u32,
    }

    #[test]
    fn errors_name_the_range_and_values_out_of_range_are_read() {
        let read = |text: &str| match serde_json::from_str::<Request>(text) {
            Ok(request) => format!("{:?} {}", request.limit, request.ttl_s),
            Err(error) => error.to_string(),
        };
        assert_eq!(read(r#"{"ttl_s": 0}"#), "None 0");
        assert_eq!(read(r#"{"ttl_s": 7, "limit": null}"#), "None 7");
        assert_eq!(read(r#"{"ttl_s": 7, "limit": 4294967295}"#), "Some(4294967295) 7");
        let (limit, ttl) = ("expected an integer from 1 to 500", "expected an integer from 1 to 86400");
        for invalid in ["-1", "4294967296", "1.5", "\"7\"", "[]"] {
            assert!(read(&format!("{{\"ttl_s\": 7, \"limit\": {invalid}}}")).contains(limit), "{invalid}");
            assert!(read(&format!("{{\"ttl_s\": {invalid}}}")).contains(ttl), "{invalid}");
        }
    }
}
