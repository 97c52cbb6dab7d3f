//! [`DockingDesign`]: a layout as a list of deputies with their geometry, and its JSON form.
//!
//! Numbers are integers, since grammars that constrain a language model enforce the range of integers but not of fractions.

use std::collections::BTreeMap;

use env_core::docking::constants::MAX_DEPUTIES;
use env_core::docking::relative_motion::{RelativeState, speed_limit};
use serde_json::{Value, json};

use super::vocabulary::{AZIMUTH, BEARING, CLOSING, CROSS, CROSS_DIRECTION, DISTANCE, ELEVATION, NUMBERS};
use crate::design_fields::{parse_list, parse_mode, parse_name, parse_object, parse_params, reject_unknown};
use crate::field_error::FieldError;

/// Start of a deputy. Numbers are as in JSON; [`Bound::value`](crate::Bound::value) converts them to quantities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct DeputyStart {
    /// Distance from the chief, see [`DISTANCE`].
    pub distance: i32,
    /// Azimuth of the position, see [`AZIMUTH`].
    pub azimuth_deg: i32,
    /// Elevation of the position, see [`ELEVATION`].
    pub elevation_deg: i32,
    /// Speed towards the chief, see [`CLOSING`].
    pub closing_speed: i32,
    /// Speed across the line to the chief, see [`CROSS`].
    pub cross_speed: i32,
    /// Direction of the cross speed, see [`CROSS_DIRECTION`].
    pub cross_deg: i32,
}

/// Failure that a design aims to cause.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DockingAim {
    /// Failure mode of the task.
    pub mode: String,
    /// Bearing, from the deputy that is to fail, of the body that it is to meet: the chief, or another deputy in a collision. In the
    /// plane of the orbit, degrees from radial out to in-track; `None` if any will do.
    pub bearing_deg: Option<i32>,
}

/// Layout as its designer describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct DockingDesign {
    /// Name of the layout, for display.
    pub name: String,
    /// Failure that the layout aims to cause.
    pub aim: DockingAim,
    /// Params that replace those of the base scenario.
    pub params: BTreeMap<String, f64>,
    /// Deputies, at least one.
    pub deputies: Vec<DeputyStart>,
}

impl DeputyStart {
    /// Numbers in the order of [`NUMBERS`].
    pub(super) const fn numbers(&self) -> [i32; 6] {
        let Self { distance, azimuth_deg, elevation_deg, closing_speed, cross_speed, cross_deg } = *self;
        [distance, azimuth_deg, elevation_deg, closing_speed, cross_speed, cross_deg]
    }

    const fn from_numbers(numbers: [i32; 6]) -> Self {
        let [distance, azimuth_deg, elevation_deg, closing_speed, cross_speed, cross_deg] = numbers;
        Self { distance, azimuth_deg, elevation_deg, closing_speed, cross_speed, cross_deg }
    }

    /// Returns the JSON form.
    #[must_use]
    pub fn to_json(&self) -> Value {
        NUMBERS.iter().zip(self.numbers()).map(|(bound, number)| (bound.name, Value::from(number))).collect()
    }

    /// Parses the JSON form. `path` is the position of the deputy, such as `deputies.0`.
    fn parse(path: &str, value: &Value) -> Result<Self, FieldError> {
        let fields = parse_object(path, value)?;
        reject_unknown(path, fields, &NUMBERS.map(|bound| bound.name))?;
        let mut numbers = [0; NUMBERS.len()];
        for (number, bound) in numbers.iter_mut().zip(NUMBERS) {
            *number = bound.parse(path, fields)?;
        }
        Ok(Self::from_numbers(numbers))
    }

    /// Returns the state in Hill's frame.
    #[must_use]
    pub fn state(&self) -> RelativeState {
        let distance = DISTANCE.value(self.distance);
        let limit = speed_limit(distance);
        let (sin_az, cos_az) = libm::sincos(AZIMUTH.value(self.azimuth_deg).to_radians());
        let (sin_el, cos_el) = libm::sincos(ELEVATION.value(self.elevation_deg).to_radians());
        let (sin_across, cos_across) = libm::sincos(CROSS_DIRECTION.value(self.cross_deg).to_radians());
        let outward = self.direction();
        let along_azimuth = [-sin_az, cos_az, 0.0];
        let along_elevation = [-sin_el * cos_az, -sin_el * sin_az, cos_el];
        let closing = limit * CLOSING.value(self.closing_speed) / 100.0;
        let cross = limit * CROSS.value(self.cross_speed) / 100.0;
        let velocity = |axis: usize| {
            let across = cos_across * along_azimuth[axis] + sin_across * along_elevation[axis];
            cross * across - closing * outward[axis]
        };
        let [x, y, z] = outward.map(|part| distance * part);
        [x, y, z, velocity(0), velocity(1), velocity(2)]
    }

    /// Unit vector from the chief to the deputy.
    fn direction(&self) -> [f64; 3] {
        let (sin_az, cos_az) = libm::sincos(AZIMUTH.value(self.azimuth_deg).to_radians());
        let (sin_el, cos_el) = libm::sincos(ELEVATION.value(self.elevation_deg).to_radians());
        [cos_el * cos_az, cos_el * sin_az, sin_el]
    }

    /// Returns the angle between the directions of two deputies from the chief, in degrees. It is exactly 0 for equal ones.
    pub(super) fn direction_angle_deg(&self, other: &Self) -> f64 {
        let ([ax, ay, az], [bx, by, bz]) = (self.direction(), other.direction());
        let cross = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
        let sin = (cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]).sqrt();
        libm::atan2(sin, ax * bx + ay * by + az * bz).to_degrees()
    }
}

impl DockingDesign {
    /// Returns the JSON form.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!({
            "name": self.name,
            "aim": {"mode": self.aim.mode, "bearing_deg": self.aim.bearing_deg},
            "params": self.params,
            "deputies": self.deputies.iter().map(DeputyStart::to_json).collect::<Vec<_>>(),
        })
    }

    /// Parses the JSON form. Does not check the failure mode, the params and the number of deputies against the task.
    ///
    /// # Errors
    /// Returns the first invalid field, and which values are allowed.
    pub fn from_json(value: &Value) -> Result<Self, FieldError> {
        let fields = parse_object("design", value)?;
        reject_unknown("design", fields, &["name", "aim", "params", "deputies"])?;
        let aim = parse_object("aim", fields.get("aim").unwrap_or(&Value::Null))?;
        reject_unknown("aim", aim, &["mode", BEARING.name])?;
        let deputies = fields.get("deputies");
        Ok(Self {
            name: parse_name(fields),
            aim: DockingAim { mode: parse_mode(aim)?, bearing_deg: BEARING.parse_optional("aim", aim)? },
            params: parse_params(fields.get("params"))?,
            deputies: parse_list("deputies", "deputies", deputies, MAX_DEPUTIES, DeputyStart::parse)?,
        })
    }
}
