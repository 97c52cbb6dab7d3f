//! Vocabulary of designs: numbers with their bounds.
//!
//! The JSON schema, the prompt, the documentation and the compiler all use these definitions. Names and descriptions are part
//! of the prompt: changing one changes the prompt.

use env_core::tasking::setup::environment::DEFAULT_STATIONS;
use env_core::tasking::task::MAX_SATELLITES;
use serde_json::{Map, Value};

use crate::field_error::FieldError;
use crate::untrusted_text::shorten;

/// Maximum number of target fields in a layout.
pub const MAX_FIELDS: usize = 8;
/// Maximum number of ground stations that a layout puts out of service. At least one stays.
pub const MAX_OUTAGES: usize = DEFAULT_STATIONS.len() - 1;

/// Bounds and meaning of one whole number of a design.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WholeNumber {
    /// Name of the field.
    pub name: &'static str,
    /// Smallest value that is allowed.
    pub min: i32,
    /// Largest value that is allowed.
    pub max: i32,
    /// Meaning of the number, in one sentence.
    pub description: &'static str,
}

const fn number(name: &'static str, [min, max]: [i32; 2], description: &'static str) -> WholeNumber {
    WholeNumber { name, min, max, description }
}

/// Day of the epoch.
pub const DAY: WholeNumber = number("day", [1, 365], "day of the year: the season of the Sun");
/// Time of the epoch.
pub const UTC_MINUTE: WholeNumber =
    number("utc_minute", [0, 1439], "minute of the day in UTC: which ground stations the orbit passes");
/// Local solar time of the ascending node.
pub const NODE_HOUR: WholeNumber = number(
    "node_hour",
    [0, 23],
    "local solar time, in hours, at which satellite 0 crosses the equator northwards; 0 and 12 give the longest shadows, 6 and 18 \
     the shortest",
);
/// Orbit angle at the start.
pub const START_ANGLE: WholeNumber = number(
    "start_angle_deg",
    [0, 359],
    "place of satellite 0 on its orbit at the start, in degrees from local noon in the direction of motion; 180 is midnight",
);
/// Charge at the start.
pub const BATTERY: WholeNumber =
    number("battery_percent", [5, 100], "charge of every battery at the start, in percent of its capacity");
/// Speed of the wheels at the start.
pub const WHEELS: WholeNumber = number(
    "wheels_percent",
    [0, 95],
    "speed of the fastest wheel of every satellite at the start, in percent of the speed that ends its life",
);
/// Data at the start.
pub const STORAGE: WholeNumber =
    number("storage_percent", [0, 100], "data in every storage at the start, in percent of its capacity");
/// Number of a ground station in an outage.
pub const STATION: WholeNumber = number(
    "outages",
    [0, DEFAULT_STATIONS.len() as i32 - 1],
    "numbers of the ground stations that are out of service",
);

/// The numbers of a start, in the order of the schema.
pub const START_NUMBERS: [WholeNumber; 7] =
    [DAY, UTC_MINUTE, NODE_HOUR, START_ANGLE, BATTERY, WHEELS, STORAGE];

/// Index of the satellite that passes a field.
pub const SATELLITE: WholeNumber =
    number("satellite", [0, MAX_SATELLITES as i32 - 1], "index of the satellite that passes the field");
/// Time of the pass over a field.
pub const MINUTE: WholeNumber =
    number("minute", [1, 940], "minute of the episode at which the satellite passes the middle of the field");
/// Distance of a field from the track.
pub const OFFSET: WholeNumber = number(
    "offset_km",
    [-600, 600],
    "distance of the field's middle from the point below the satellite, in km to the right of its motion; negative to the left",
);
/// Radius of a field.
pub const SPREAD: WholeNumber = number("spread_km", [1, 900], "radius of the field, in km");
/// Number of targets of a field.
pub const TARGETS: WholeNumber =
    number("targets", [1, 60], "number of targets, spread evenly over the field");
/// Lowest priority of a field.
pub const PRIORITY_LOW: WholeNumber =
    number("priority_low", [1, 100], "lowest priority of its targets, in hundredths");
/// Highest priority of a field.
pub const PRIORITY_HIGH: WholeNumber = number(
    "priority_high",
    [1, 100],
    "highest priority of its targets, in hundredths; the others are between, mixed over the field",
);

/// The numbers of a field, in the order of the schema.
pub const FIELD_NUMBERS: [WholeNumber; 7] =
    [SATELLITE, MINUTE, OFFSET, SPREAD, TARGETS, PRIORITY_LOW, PRIORITY_HIGH];

/// Angle of the aim.
pub const AIM_ANGLE: WholeNumber = number(
    "orbit_angle_deg",
    [0, 359],
    "orbit angle at which the failure is meant to begin, in degrees from local noon; null for any",
);

impl WholeNumber {
    /// Returns true if a number is within the bounds.
    #[must_use]
    pub fn contains(&self, number: i32) -> bool {
        (self.min..=self.max).contains(&number)
    }

    /// Returns the nearest number within the bounds.
    pub(super) fn clamp(&self, number: i32) -> i32 {
        number.clamp(self.min, self.max)
    }

    /// Parses the number from the fields of the object at `path`.
    pub(super) fn parse(&self, path: &str, fields: &Map<String, Value>) -> Result<i32, FieldError> {
        match fields.get(self.name) {
            Some(value) => self.parse_value(&format!("{path}.{}", self.name), value),
            None => {
                let message = format!("is required; {}", self.wanted());
                Err(FieldError::new(format!("{path}.{}", self.name), message))
            }
        }
    }

    /// Parses the number at `field`.
    pub(super) fn parse_value(&self, field: &str, value: &Value) -> Result<i32, FieldError> {
        let number = value.as_i64().and_then(|number| i32::try_from(number).ok());
        number.filter(|number| self.contains(*number)).ok_or_else(|| {
            FieldError::new(field, format!("{}, got {}", self.wanted(), shorten(&value.to_string())))
        })
    }

    fn wanted(&self) -> String {
        format!("must be an integer from {} to {}", self.min, self.max)
    }
}
