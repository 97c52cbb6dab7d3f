//! [`Bound`]: bounds and meaning of one whole number of a design.

use std::fmt::Display;

use env_core::KeyedRng;
use serde_json::{Map, Value};

use crate::field_error::FieldError;
use crate::untrusted_text::shorten;

/// Bounds and meaning of one whole number of a design. `T` is the integer type of the number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound<T> {
    /// Name of the field.
    pub name: &'static str,
    /// Smallest value that is allowed.
    pub min: T,
    /// Largest value that is allowed.
    pub max: T,
    /// Value of the number that stands for one `unit` of the quantity.
    pub per_unit: f64,
    /// Unit of the quantity; empty for an index, a count or a share.
    pub unit: &'static str,
    /// Meaning of the number, in one sentence.
    pub description: &'static str,
}

impl<T: Copy + Display + Into<f64> + Into<i64> + TryFrom<i64>> Bound<T> {
    /// Returns the quantity that a number stands for, in `unit`.
    #[must_use]
    pub fn value(&self, number: T) -> f64 {
        let number: f64 = number.into();
        number / self.per_unit
    }

    /// Returns the number that is nearest to a quantity in `unit`, within the bounds.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "a number beyond the bounds is clamped anyway")]
    pub fn nearest(&self, value: f64) -> T {
        self.clamp(libm::round(value * self.per_unit) as i64)
    }

    /// Returns true if a number is within the bounds.
    #[must_use]
    pub fn contains(&self, number: T) -> bool {
        self.contains_integer(number.into())
    }

    /// Returns the nearest number within the bounds.
    pub(crate) fn clamp(&self, number: i64) -> T {
        T::try_from(number.clamp(self.min.into(), self.max.into())).unwrap_or(self.min)
    }

    /// Changes a number by up to `max_change` either way, within the bounds.
    pub(crate) fn jitter(&self, number: T, max_change: u32, rng: &mut KeyedRng) -> T {
        let number: i64 = number.into();
        self.clamp(number + draw_change(max_change, rng))
    }

    /// Changes a number on a circle by up to `max_change` either way. The number after the largest one is the smallest one.
    pub(crate) fn turn(&self, number: T, max_change: u32, rng: &mut KeyedRng) -> T {
        let (number, min, max): (i64, i64, i64) = (number.into(), self.min.into(), self.max.into());
        self.clamp(min + (number - min + draw_change(max_change, rng)).rem_euclid(max - min + 1))
    }

    /// Parses the required number from the fields of the object at `path`.
    pub(crate) fn parse(&self, path: &str, fields: &Map<String, Value>) -> Result<T, FieldError> {
        let field = format!("{path}.{}", self.name);
        match fields.get(self.name) {
            Some(value) => self.parse_value(&field, value),
            None => Err(FieldError::new(field, format!("is required; {}", self.requirement()))),
        }
    }

    /// Parses the number from the fields of the object at `path`; `None` if it is missing or null.
    pub(crate) fn parse_optional(
        &self,
        path: &str,
        fields: &Map<String, Value>,
    ) -> Result<Option<T>, FieldError> {
        let value = fields.get(self.name).filter(|value| !value.is_null());
        value.map(|value| self.parse_value(&format!("{path}.{}", self.name), value)).transpose()
    }

    /// Parses the number at `field`.
    pub(crate) fn parse_value(&self, field: &str, value: &Value) -> Result<T, FieldError> {
        let number = value.as_i64().filter(|number| self.contains_integer(*number));
        number.map(|number| self.clamp(number)).ok_or_else(|| {
            FieldError::new(field, format!("{}, got {}", self.requirement(), shorten(&value.to_string())))
        })
    }

    fn contains_integer(&self, number: i64) -> bool {
        (self.min.into()..=self.max.into()).contains(&number)
    }

    fn requirement(&self) -> String {
        format!("must be an integer from {} to {}", self.min, self.max)
    }
}

/// Draws a change of up to `max_change` either way.
pub(crate) fn draw_change(max_change: u32, rng: &mut KeyedRng) -> i64 {
    i64::from(rng.range_inclusive(0, 2 * max_change)) - i64::from(max_change)
}

#[cfg(test)]
mod tests {
    use env_core::keyed_rng::RngPurpose;
    use serde_json::json;

    use super::*;

    const SPEED: Bound<i32> =
        Bound { name: "speed", min: -20, max: 30, per_unit: 10.0, unit: "m/s", description: "" };
    const HOUR: Bound<u32> =
        Bound { name: "hour", min: 1, max: 24, per_unit: 1.0, unit: "h", description: "" };

    #[test]
    fn numbers_stand_for_quantities_within_bounds() {
        assert_eq!((SPEED.value(25), SPEED.nearest(1.26), SPEED.nearest(-7.0)), (2.5, 13, -20));
        assert_eq!((SPEED.nearest(f64::INFINITY), SPEED.clamp(i64::MIN)), (30, -20));
        assert!(SPEED.contains(30) && !SPEED.contains(31) && !HOUR.contains(0));
    }

    #[test]
    fn changes_stay_within_bounds_or_wrap() {
        let mut rng = KeyedRng::new(RngPurpose::Design, 1, 1);
        let jittered: Vec<i32> = (0..300).map(|_| SPEED.jitter(28, 4, &mut rng)).collect();
        assert!(jittered.iter().all(|number| (24..=30).contains(number)), "{jittered:?}");
        let turned: Vec<u32> = (0..300).map(|_| HOUR.turn(24, 2, &mut rng)).collect();
        assert!([22, 23, 24, 1, 2].iter().all(|hour| turned.contains(hour)), "{turned:?}");
        assert!(turned.iter().all(|hour| [22, 23, 24, 1, 2].contains(hour)), "{turned:?}");
    }

    #[test]
    fn parsing_names_the_field_and_the_bounds() {
        let fields = json!({"speed": 31, "hour": 7});
        let fields = fields.as_object().unwrap();
        let error = SPEED.parse("deputies.0", fields).unwrap_err();
        assert_eq!(error.to_string(), "deputies.0.speed: must be an integer from -20 to 30, got 31");
        assert_eq!(HOUR.parse("start", fields), Ok(7));
        let empty = Map::new();
        let missing = HOUR.parse("start", &empty).unwrap_err();
        assert_eq!(missing.to_string(), "start.hour: is required; must be an integer from 1 to 24");
        assert_eq!(HOUR.parse_optional("aim", &empty), Ok(None));
        assert_eq!(HOUR.parse_optional("aim", json!({"hour": null}).as_object().unwrap()), Ok(None));
        assert_eq!(HOUR.parse_optional("aim", fields), Ok(Some(7)));
        assert!(SPEED.parse_optional("aim", fields).is_err());
    }
}
