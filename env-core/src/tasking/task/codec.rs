//! JSON format of one step of an action log: a list of actions, each `[satellite, action]` or `{"satellite": 0, "action": 2}`, the
//! action by its index.

use crate::task::EntryFormat;

/// Format of an action.
pub(super) const ACTION_FORMAT: EntryFormat<2> = EntryFormat {
    entry: "action",
    agent: "satellite",
    value: "the index of an action",
    list: "[satellite, action]",
    fields: ["satellite", "action"],
};
