//! JSON format of one step of an action log: a list of burns, each `[satellite, dvx, dvy]` or, as in the
//! public kessler-env, `{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0.0}`.

use crate::task::EntryFormat;

/// Format of a burn.
pub(super) const BURN_FORMAT: EntryFormat<3> = EntryFormat {
    entry: "burn",
    agent: "satellite",
    value: "a change of speed",
    list: "[satellite, dvx, dvy]",
    fields: ["satellite_id", "delta_vx", "delta_vy"],
};
