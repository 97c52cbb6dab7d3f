//! JSON format of one step of an action log: a list of thrusts, each `[deputy, fx, fy, fz]` or
//! `{"deputy": 0, "fx": 0.5, "fy": 0.0, "fz": -0.2}`, in N.

use crate::task::EntryFormat;

/// Format of a thrust.
pub(super) const THRUST_FORMAT: EntryFormat<4> = EntryFormat {
    entry: "thrust",
    agent: "deputy",
    value: "a thrust",
    list: "[deputy, fx, fy, fz]",
    fields: ["deputy", "fx", "fy", "fz"],
};
