//! Explicit bodies of a scenario.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::read::{known, number, object, shorten, text, wrong};
use crate::error::ScenarioError;

/// Explicit bodies that replace or extend what the generator would draw.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Whether the tables given replace the generator's bodies or stand after them.
    pub mode: LayoutMode,
    /// Tables of rows, by name; names and columns are the world's.
    pub bodies: BTreeMap<String, Vec<Vec<f64>>>,
    /// How the bodies were thought of. Not part of the identity.
    pub provenance: Option<Value>,
}

/// How a layout's bodies relate to the generator's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayoutMode {
    /// The tables given stand instead of the generator's.
    Replace,
    /// The bodies given stand after the generator's, where the world has room for more: kessler has three satellites
    /// always, and those given stand instead of its own in either mode.
    Extend,
}

impl LayoutMode {
    /// The word on the wire.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Replace => "replace",
            Self::Extend => "extend",
        }
    }
}

/// Most rows a layout may have over all its tables.
pub const MAX_LAYOUT_ROWS: usize = 512;

impl Layout {
    /// The wire form.
    pub(super) fn to_json(&self) -> Value {
        json!({
            "mode": self.mode.word(),
            "bodies": self.bodies,
            "provenance": self.provenance,
        })
    }

    /// Reads the wire form; what the tables mean is the world's to check.
    pub(super) fn from_json(value: &Value) -> Result<Self, ScenarioError> {
        let fields = object("layout", value)?;
        known("layout.", fields, &["mode", "bodies", "provenance"])?;
        let mode = match text("layout.mode", fields.get("mode"), "replace or extend")? {
            "replace" => LayoutMode::Replace,
            "extend" => LayoutMode::Extend,
            other => {
                return Err(ScenarioError::UnknownChoice {
                    field: "layout.mode".to_owned(),
                    value: shorten(other),
                    choices: "replace, extend".to_owned(),
                });
            }
        };
        let mut bodies = BTreeMap::new();
        let given = fields.get("bodies").ok_or_else(|| ScenarioError::Missing {
            field: "layout.bodies".to_owned(),
            wanted: "tables of rows by name".to_owned(),
        })?;
        for (name, table) in object("layout.bodies", given)? {
            let field = format!("layout.bodies.{}", shorten(name));
            let rows = table.as_array().ok_or_else(|| wrong(&field, table, "a list of rows"))?;
            if rows.len() > MAX_LAYOUT_ROWS {
                return Err(ScenarioError::Layout {
                    field,
                    reason: format!("{} rows; at most {MAX_LAYOUT_ROWS} are taken", rows.len()),
                });
            }
            let mut parsed = Vec::with_capacity(rows.len());
            for (i, row) in rows.iter().enumerate() {
                let field = format!("{field}.{i}");
                let cells = row.as_array().ok_or_else(|| wrong(&field, row, "a list of numbers"))?;
                let numbers: Result<Vec<f64>, _> =
                    cells.iter().enumerate().map(|(j, c)| number(&format!("{field}.{j}"), c)).collect();
                parsed.push(numbers?);
            }
            bodies.insert(name.clone(), parsed);
        }
        let provenance = fields.get("provenance").filter(|v| !v.is_null()).cloned();
        Ok(Self { mode, bodies, provenance })
    }
}
