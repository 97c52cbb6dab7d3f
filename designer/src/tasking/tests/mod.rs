//! Tests of the language against the engine: compiled layouts start as the design says, and the critique agrees with the aim.

mod compile;
mod documentation;
mod fuzz;
mod gate;
mod mutate;
mod prompt;
mod siblings;

use std::sync::Arc;

use env_core::{Recipe, Scenario};
use serde_json::{Value, json};

use crate::{DesignBrief, Gate, design_language};

pub(super) const TASKS: [&str; 3] = ["tasking/scanning", "tasking/imaging", "tasking/constellation"];
pub(super) const SCANNING: &str = "tasking/scanning";
pub(super) const IMAGING: &str = "tasking/imaging";
pub(super) const CONSTELLATION: &str = "tasking/constellation";

/// A brief for four layouts at a level of a task. Episodes are as short as the aims allow, so that tests are fast.
pub(super) fn brief_at_level(task_id: &str, level: u32, seed: u64) -> DesignBrief {
    let task = env_core::task(task_id).unwrap();
    let mut recipe = Recipe::at_level(task, level as usize).unwrap();
    recipe = recipe.with_param("time_limit_s", 8700.0).unwrap();
    if task_id != SCANNING {
        recipe = recipe.with_param("targets", 1000.0).unwrap();
    }
    DesignBrief::new(Arc::new(recipe), 4, seed).at_level(task.levels(), level)
}

/// A gate of tasking with an empty archive.
pub(super) fn empty_gate() -> Gate {
    Gate::new(design_language(env_core::task(SCANNING).unwrap()).unwrap(), Vec::new())
}

pub(super) fn start_json() -> Value {
    json!({
        "day": 80, "utc_minute": 300, "node_hour": 12, "start_angle_deg": 60, "battery_percent": 60,
        "wheels_percent": 20, "storage_percent": 30,
    })
}

pub(super) fn field_json(minute: i32, targets: i32) -> Value {
    json!({
        "satellite": 0, "minute": minute, "offset_km": 60, "spread_km": 150, "targets": targets,
        "priority_low": 10, "priority_high": 90,
    })
}

/// A design with a start, and with fields if the task has targets.
pub(super) fn design_json(task: &str, mode: &str) -> Value {
    let fields = if task == SCANNING { json!([]) } else { json!([field_json(20, 30), field_json(60, 30)]) };
    json!({
        "name": "x", "aim": {"mode": mode}, "params": {}, "start": start_json(), "outages": [],
        "background": task == SCANNING, "fields": fields,
    })
}

/// The scenario of a layout as it is stored.
pub(super) fn stored(scenario: &Scenario) -> Scenario {
    Scenario::from_json(&scenario.to_json()).unwrap()
}
