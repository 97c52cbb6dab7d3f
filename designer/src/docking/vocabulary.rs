//! Vocabulary of designs: numbers of a deputy with their bounds.
//!
//! The JSON schema, the prompt, the documentation and the compiler all use these definitions. Names and descriptions are part
//! of the prompt: changing one changes the prompt.

use serde_json::{Map, Value};

use crate::brief::{DesignBrief, ParamChoice};
use crate::design_fields::parse_integer;
use crate::field_error::FieldError;

/// Bounds and meaning of one number of a deputy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeputyBound {
    /// Name of the field.
    pub name: &'static str,
    /// Smallest value that is allowed.
    pub min: i32,
    /// Largest value that is allowed.
    pub max: i32,
    /// Number of units of the field in one `unit`.
    pub per_unit: f64,
    /// Unit of the quantity.
    pub unit: &'static str,
    /// Meaning of the number, in one sentence.
    pub description: &'static str,
}

/// Distance from the chief. The largest is that of the param `start_radius`.
pub const DISTANCE: DeputyBound = DeputyBound {
    name: "distance",
    min: 20,
    max: 10_000,
    per_unit: 10.0,
    unit: "m",
    description: "distance from the chief, in tenths of a metre",
};
/// Direction of the position in the plane of the orbit.
pub const AZIMUTH: DeputyBound = DeputyBound {
    name: "azimuth_deg",
    min: 0,
    max: 359,
    per_unit: 1.0,
    unit: "degrees",
    description: "direction from the chief in the plane of its orbit: 0 is radial out, 90 in-track (ahead), 180 radial in, 270 behind",
};
/// Direction of the position out of the plane of the orbit.
pub const ELEVATION: DeputyBound = DeputyBound {
    name: "elevation_deg",
    min: -90,
    max: 90,
    per_unit: 1.0,
    unit: "degrees",
    description: "direction from the chief out of the plane of its orbit: 90 is cross-track",
};
/// Speed towards the chief. The largest magnitude is that of the param `speed_ratio`.
pub const CLOSING: DeputyBound = DeputyBound {
    name: "closing_speed",
    min: -500,
    max: 500,
    per_unit: 1.0,
    unit: "% of the speed limit",
    description: "speed towards the chief, in percent of the speed limit at the distance; negative is away from it",
};
/// Speed across the line to the chief.
pub const CROSS: DeputyBound = DeputyBound {
    name: "cross_speed",
    min: 0,
    max: 500,
    per_unit: 1.0,
    unit: "% of the speed limit",
    description: "speed across the line to the chief, in percent of the speed limit at the distance",
};
/// Direction of the speed across the line to the chief.
pub const CROSS_DIRECTION: DeputyBound = DeputyBound {
    name: "cross_deg",
    min: 0,
    max: 359,
    per_unit: 1.0,
    unit: "degrees",
    description: "direction of the cross speed: 0 is towards larger azimuth, 90 towards larger elevation",
};

/// Bearing of an aim, in the frame of the failure profile.
pub const BEARING: DeputyBound = DeputyBound {
    name: "bearing_deg",
    min: 0,
    max: 359,
    per_unit: 1.0,
    unit: "degrees",
    description: "direction, from the deputy that is to fail, to the chief, or in a collision to the other deputy: 0 is radial out, \
                  90 in-track",
};

/// Numbers of a deputy, in the order of the JSON form.
pub const NUMBERS: [DeputyBound; 6] = [DISTANCE, AZIMUTH, ELEVATION, CLOSING, CROSS, CROSS_DIRECTION];

impl DeputyBound {
    /// Returns the quantity that a number stands for, in `unit`.
    #[must_use]
    pub fn value(&self, number: i32) -> f64 {
        f64::from(number) / self.per_unit
    }

    /// Returns the number that is nearest to a quantity in `unit`, within the bounds.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "the number is within the bounds")]
    pub fn nearest(&self, value: f64) -> i32 {
        let number = libm::round(value * self.per_unit);
        number.clamp(f64::from(self.min), f64::from(self.max)) as i32
    }

    /// Parses the number from the fields of the object at `path`.
    pub(super) fn parse(&self, path: &str, fields: &Map<String, Value>) -> Result<i32, FieldError> {
        let number = parse_integer(path, fields, self.name, self.min.into()..=self.max.into())?;
        // Bounds fit, so a number within them does too.
        Ok(i32::try_from(number).unwrap_or(self.min))
    }
}

/// Returns the choices of a brief that act on a given start. The number of deputies is that of the list, and the other params
/// decide only how the task draws starts.
pub(super) fn effective_choices(brief: &DesignBrief) -> Vec<&ParamChoice> {
    let has_effect = |param: &str| matches!(param, "time_limit_s" | "thrust_bound");
    brief.param_choices.iter().filter(|choice| has_effect(&choice.param)).collect()
}

/// Returns an angle as a whole number from 0 to 359.
#[expect(clippy::cast_possible_truncation, reason = "a whole number from 0 to 359")]
pub(super) fn wrap_degrees(angle_deg: f64) -> i32 {
    let rounded = libm::round(angle_deg);
    ((rounded - libm::floor(rounded / 360.0) * 360.0) as i32).min(AZIMUTH.max)
}

/// Returns the angle between two directions in degrees, 0 to 180.
pub(super) fn angle_between(a_deg: f64, b_deg: f64) -> f64 {
    let turn = a_deg - b_deg;
    let wrapped = turn - libm::floor(turn / 360.0) * 360.0;
    wrapped.min(360.0 - wrapped)
}
