//! Layouts: explicit initial bodies of a scenario.

use std::collections::BTreeMap;

use serde_json::{Value, json};

/// Largest number of rows of a layout over all its tables.
pub const MAX_LAYOUT_ROWS: usize = 512;

/// Explicit bodies that replace or extend those that the generator would draw.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// How the tables relate to the generator's bodies.
    pub mode: LayoutMode,
    /// Tables of rows, by name. Names and columns are defined by the world.
    pub bodies: BTreeMap<String, Vec<Vec<f64>>>,
    /// How the layout was designed. It is not part of the recipe's identity.
    pub provenance: Option<Value>,
}

/// How a layout's bodies relate to the generator's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayoutMode {
    /// The tables replace those of the generator.
    Replace,
    /// The bodies are appended to the generator's, in worlds with room for more. In kessler, which always has three
    /// satellites, those of the layout replace the generator's in either mode.
    Extend,
}

impl LayoutMode {
    /// Name of the mode in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Replace => "replace",
            Self::Extend => "extend",
        }
    }
}

impl Layout {
    /// The layout as JSON.
    pub(super) fn to_json(&self) -> Value {
        json!({
            "mode": self.mode.name(),
            "bodies": self.bodies,
            "provenance": self.provenance,
        })
    }
}
