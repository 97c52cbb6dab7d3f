//! Parses recipes and scenarios from JSON. This is above [`crate::registry`], which finds the task by its id.

use std::collections::BTreeMap;

use serde_json::{Map, Value};

use crate::error::ScenarioError;
use crate::json_fields::{read_number, read_object, read_text, reject_unknown_fields, wrong_type};
use crate::registry;
use crate::seed::{SEED_REQUIREMENT, Seed};
use crate::task::{Layout, LayoutMode, MAX_LAYOUT_ROWS, Recipe, Scenario, TaskSpec};
use crate::text::{MAX_QUOTED_CHARS, shorten};

impl Recipe {
    /// Parses a recipe. Params and options that are absent have their defaults.
    ///
    /// # Errors
    /// Returns an error that names the field if one is unknown, missing, of the wrong type or out of range.
    pub fn from_json(value: &Value) -> Result<Self, ScenarioError> {
        let fields = read_object("scenario", value)?;
        reject_unknown_fields("", fields, &["world", "task", "params", "physics", "layout"])?;
        parse_recipe(fields)
    }
}

impl Scenario {
    /// Parses a scenario. The seed may be in any [`SeedSpace`](crate::SeedSpace); callers that accept user seeds only
    /// check that themselves.
    ///
    /// # Errors
    /// Returns an error that names the field if one is unknown, missing, of the wrong type or out of range.
    pub fn from_json(value: &Value) -> Result<Self, ScenarioError> {
        let fields = read_object("scenario", value)?;
        reject_unknown_fields("", fields, &["world", "task", "params", "physics", "layout", "seed"])?;
        let seed = fields.get("seed").ok_or_else(|| ScenarioError::Missing {
            field: "seed".to_owned(),
            wanted: SEED_REQUIREMENT.to_owned(),
        })?;
        let seed = Seed::new(seed.as_u64().ok_or_else(|| wrong_type("seed", seed, SEED_REQUIREMENT))?)?;
        Ok(Self::new(parse_recipe(fields)?, seed))
    }
}

fn parse_recipe(fields: &Map<String, Value>) -> Result<Recipe, ScenarioError> {
    let task = parse_task(fields)?;
    let mut params = Vec::new();
    if let Some(given) = fields.get("params").filter(|v| !v.is_null()) {
        for (name, value) in read_object("params", given)? {
            let field = format!("params.{}", shorten(name, MAX_QUOTED_CHARS));
            params.push((name.as_str(), read_number(&field, value)?));
        }
    }
    let mut recipe = Recipe::with_params(task, params.into_iter())?;
    if let Some(given) = fields.get("physics").filter(|v| !v.is_null()) {
        for (name, choice) in read_object("physics", given)? {
            let name = shorten(name, MAX_QUOTED_CHARS);
            let choice = read_text(&format!("physics.{name}"), Some(choice), "a word")?;
            recipe.set_option(&name, choice)?;
        }
    }
    let layout = match fields.get("layout") {
        None | Some(Value::Null) => None,
        Some(given) => Some(parse_layout(given)?),
    };
    recipe.with_layout(layout)
}

fn parse_task(fields: &Map<String, Value>) -> Result<&'static dyn TaskSpec, ScenarioError> {
    let id = read_text("task", fields.get("task"), "the id of a task, such as kessler/survival")?;
    let Some(task) = registry::task(id) else {
        return Err(ScenarioError::UnknownChoice {
            field: "task".to_owned(),
            value: shorten(id, MAX_QUOTED_CHARS),
            choices: registry::tasks().map(TaskSpec::id).collect::<Vec<_>>().join(", "),
        });
    };
    if let Some(world) = fields.get("world") {
        let world = read_text("world", Some(world), "a world and its version")?;
        if world != task.world() {
            return Err(ScenarioError::UnknownChoice {
                field: "world".to_owned(),
                value: shorten(world, MAX_QUOTED_CHARS),
                choices: task.world().to_owned(),
            });
        }
    }
    Ok(task)
}

/// Parses a layout; the world checks names and columns of the tables.
fn parse_layout(value: &Value) -> Result<Layout, ScenarioError> {
    let fields = read_object("layout", value)?;
    reject_unknown_fields("layout.", fields, &["mode", "bodies", "provenance"])?;
    let mode = match read_text("layout.mode", fields.get("mode"), "replace or extend")? {
        "replace" => LayoutMode::Replace,
        "extend" => LayoutMode::Extend,
        other => {
            return Err(ScenarioError::UnknownChoice {
                field: "layout.mode".to_owned(),
                value: shorten(other, MAX_QUOTED_CHARS),
                choices: "replace, extend".to_owned(),
            });
        }
    };
    let given = fields.get("bodies").ok_or_else(|| ScenarioError::Missing {
        field: "layout.bodies".to_owned(),
        wanted: "tables of rows by name".to_owned(),
    })?;
    let mut bodies = BTreeMap::new();
    for (name, table) in read_object("layout.bodies", given)? {
        let field = format!("layout.bodies.{}", shorten(name, MAX_QUOTED_CHARS));
        bodies.insert(name.clone(), parse_table(&field, table)?);
    }
    let provenance = fields.get("provenance").filter(|v| !v.is_null()).cloned();
    Ok(Layout { mode, bodies, provenance })
}

fn parse_table(field: &str, table: &Value) -> Result<Vec<Vec<f64>>, ScenarioError> {
    let rows = table.as_array().ok_or_else(|| wrong_type(field, table, "a list of rows"))?;
    if rows.len() > MAX_LAYOUT_ROWS {
        return Err(ScenarioError::Layout {
            field: field.to_owned(),
            reason: format!("must have at most {MAX_LAYOUT_ROWS} rows, got {}", rows.len()),
        });
    }
    let mut parsed = Vec::with_capacity(rows.len());
    for (i, row) in rows.iter().enumerate() {
        let field = format!("{field}.{i}");
        let cells = row.as_array().ok_or_else(|| wrong_type(&field, row, "a list of numbers"))?;
        let numbers: Result<Vec<f64>, _> =
            cells.iter().enumerate().map(|(j, cell)| read_number(&format!("{field}.{j}"), cell)).collect();
        parsed.push(numbers?);
    }
    Ok(parsed)
}
