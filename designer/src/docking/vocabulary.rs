//! Vocabulary of designs: numbers of a deputy with their bounds.
//!
//! The JSON schema, the prompt, the documentation and the compiler all use these definitions. Names and descriptions are part
//! of the prompt: changing one changes the prompt.

use crate::bound::Bound;
use crate::brief::{DesignBrief, ParamChoice};

/// Distance from the chief. The largest is that of the param `start_radius`.
pub const DISTANCE: Bound<i32> = Bound {
    name: "distance",
    min: 20,
    max: 10_000,
    per_unit: 10.0,
    unit: "m",
    description: "distance from the chief, in tenths of a metre",
};
/// Direction of the position in the plane of the orbit.
pub const AZIMUTH: Bound<i32> = Bound {
    name: "azimuth_deg",
    min: 0,
    max: 359,
    per_unit: 1.0,
    unit: "degrees",
    description: "direction from the chief in the plane of its orbit: 0 is radial out, 90 in-track (ahead), 180 radial in, 270 behind",
};
/// Direction of the position out of the plane of the orbit.
pub const ELEVATION: Bound<i32> = Bound {
    name: "elevation_deg",
    min: -90,
    max: 90,
    per_unit: 1.0,
    unit: "degrees",
    description: "direction from the chief out of the plane of its orbit: 90 is cross-track",
};
/// Speed towards the chief. The largest magnitude is that of the param `speed_ratio`.
pub const CLOSING: Bound<i32> = Bound {
    name: "closing_speed",
    min: -500,
    max: 500,
    per_unit: 1.0,
    unit: "% of the speed limit",
    description: "speed towards the chief, in percent of the speed limit at the distance; negative is away from it",
};
/// Speed across the line to the chief.
pub const CROSS: Bound<i32> = Bound {
    name: "cross_speed",
    min: 0,
    max: 500,
    per_unit: 1.0,
    unit: "% of the speed limit",
    description: "speed across the line to the chief, in percent of the speed limit at the distance",
};
/// Direction of the speed across the line to the chief.
pub const CROSS_DIRECTION: Bound<i32> = Bound {
    name: "cross_deg",
    min: 0,
    max: 359,
    per_unit: 1.0,
    unit: "degrees",
    description: "direction of the cross speed: 0 is towards larger azimuth, 90 towards larger elevation",
};

/// Bearing of an aim, in the frame of the failure profile.
pub const BEARING: Bound<i32> = Bound {
    name: "bearing_deg",
    min: 0,
    max: 359,
    per_unit: 1.0,
    unit: "degrees",
    description: "direction, from the deputy that is to fail, to the chief, or in a collision to the other deputy: 0 is radial out, \
                  90 in-track",
};

/// Numbers of a deputy, in the order of the JSON form.
pub const NUMBERS: [Bound<i32>; 6] = [DISTANCE, AZIMUTH, ELEVATION, CLOSING, CROSS, CROSS_DIRECTION];

/// Returns the choices of a brief that act on a given start. The number of deputies is that of the list, and the other params
/// decide only how the task draws starts.
pub(super) fn effective_choices(brief: &DesignBrief) -> Vec<&ParamChoice> {
    let has_effect = |param: &str| matches!(param, "time_limit_s" | "thrust_bound");
    brief.param_choices.iter().filter(|choice| has_effect(&choice.param)).collect()
}
