//! Vocabulary of designs: numbers with their bounds.
//!
//! The JSON schema, the prompt, the documentation and the compiler all use these definitions. Names and descriptions are part
//! of the prompt: changing one changes the prompt.

use env_core::tasking::setup::environment::DEFAULT_STATIONS;
use env_core::tasking::task::MAX_SATELLITES;

use crate::bound::Bound;

/// Maximum number of target fields in a layout.
pub const MAX_FIELDS: usize = 8;
/// Maximum number of ground stations that a layout puts out of service. At least one stays.
pub const MAX_OUTAGES: usize = DEFAULT_STATIONS.len() - 1;

const fn number(
    name: &'static str,
    [min, max]: [i32; 2],
    unit: &'static str,
    description: &'static str,
) -> Bound<i32> {
    Bound { name, min, max, per_unit: 1.0, unit, description }
}

/// Day of the epoch.
pub const DAY: Bound<i32> = number("day", [1, 365], "days", "day of the year: the season of the Sun");
/// Time of the epoch.
pub const UTC_MINUTE: Bound<i32> = number(
    "utc_minute",
    [0, 1439],
    "minutes",
    "minute of the day in UTC: which ground stations the orbit passes",
);
/// Local solar time of the ascending node.
pub const NODE_HOUR: Bound<i32> = number(
    "node_hour",
    [0, 23],
    "hours",
    "local solar time, in hours, at which satellite 0 crosses the equator northwards; 0 and 12 give the longest shadows, 6 and 18 \
     the shortest",
);
/// Orbit angle at the start.
pub const START_ANGLE: Bound<i32> = number(
    "start_angle_deg",
    [0, 359],
    "degrees",
    "place of satellite 0 on its orbit at the start, in degrees from local noon in the direction of motion; 180 is midnight",
);
/// Charge at the start.
pub const BATTERY: Bound<i32> = number(
    "battery_percent",
    [5, 100],
    "%",
    "charge of every battery at the start, in percent of its capacity",
);
/// Speed of the wheels at the start.
pub const WHEELS: Bound<i32> = number(
    "wheels_percent",
    [0, 95],
    "%",
    "speed of the fastest wheel of every satellite at the start, in percent of the speed that ends its life",
);
/// Data at the start.
pub const STORAGE: Bound<i32> = number(
    "storage_percent",
    [0, 100],
    "%",
    "data in every storage at the start, in percent of its capacity",
);
/// Number of a ground station in an outage.
pub const STATION: Bound<i32> = number(
    "outages",
    [0, DEFAULT_STATIONS.len() as i32 - 1],
    "",
    "numbers of the ground stations that are out of service",
);

/// The numbers of a start, in the order of the schema.
pub const START_NUMBERS: [Bound<i32>; 7] =
    [DAY, UTC_MINUTE, NODE_HOUR, START_ANGLE, BATTERY, WHEELS, STORAGE];

/// Index of the satellite that passes a field.
pub const SATELLITE: Bound<i32> =
    number("satellite", [0, MAX_SATELLITES as i32 - 1], "", "index of the satellite that passes the field");
/// Time of the pass over a field.
pub const MINUTE: Bound<i32> = number(
    "minute",
    [1, 940],
    "minutes",
    "minute of the episode at which the satellite passes the middle of the field",
);
/// Distance of a field from the track.
pub const OFFSET: Bound<i32> = number(
    "offset_km",
    [-600, 600],
    "km",
    "distance of the field's middle from the point below the satellite, in km to the right of its motion; negative to the left",
);
/// Radius of a field.
pub const SPREAD: Bound<i32> = number("spread_km", [1, 900], "km", "radius of the field, in km");
/// Number of targets of a field.
pub const TARGETS: Bound<i32> =
    number("targets", [1, 60], "", "number of targets, spread evenly over the field");
/// Lowest priority of a field.
pub const PRIORITY_LOW: Bound<i32> = Bound {
    name: "priority_low",
    min: 1,
    max: 100,
    per_unit: 100.0,
    unit: "",
    description: "lowest priority of its targets, in hundredths",
};
/// Highest priority of a field.
pub const PRIORITY_HIGH: Bound<i32> = Bound {
    name: "priority_high",
    min: 1,
    max: 100,
    per_unit: 100.0,
    unit: "",
    description: "highest priority of its targets, in hundredths; the others are between, mixed over the field",
};

/// The numbers of a field, in the order of the schema.
pub const FIELD_NUMBERS: [Bound<i32>; 7] =
    [SATELLITE, MINUTE, OFFSET, SPREAD, TARGETS, PRIORITY_LOW, PRIORITY_HIGH];

/// Angle of the aim.
pub const AIM_ANGLE: Bound<i32> = number(
    "orbit_angle_deg",
    [0, 359],
    "degrees",
    "orbit angle at which the failure is meant to begin, in degrees from local noon; null for any",
);
