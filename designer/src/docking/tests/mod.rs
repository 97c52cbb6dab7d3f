//! Tests of docking's design language: closed forms against the simulation, aims, checks, the gate and the documentation.

mod approach;
mod documentation;
mod gate;
mod language;
mod siblings;

use std::sync::Arc;

use env_core::{Recipe, Scenario, Seed};
use serde_json::{Value, json};

use crate::test_support::profile_of_one_mode;
use crate::{DesignBrief, DesignLanguage, FailureProfile, Gate, design_language};

/// All failure modes that a layout can aim at.
const MODES: [&str; 5] = ["crash", "saturation", "timeout", "collision", "out_of_bounds"];

/// A brief for four layouts at a level of a task.
fn brief_at_level(task_id: &str, level: u32, seed: u64) -> DesignBrief {
    let task = env_core::task(task_id).unwrap();
    let recipe = Recipe::at_level(task, level as usize).unwrap();
    DesignBrief::new(Arc::new(recipe), 4, seed).at_level(task.levels(), level)
}

/// A profile with failures of one mode only, from sector 3 if the mode has sectors.
fn aimed_profile(task: &str, mode: &str) -> FailureProfile {
    let has_sector = matches!(mode, "crash" | "collision");
    profile_of_one_mode(task, mode, has_sector.then_some(3), has_sector.then_some(2))
}

fn language() -> &'static dyn DesignLanguage {
    design_language(env_core::task("docking/single").unwrap()).unwrap()
}

fn empty_gate() -> Gate {
    Gate::new(language(), Vec::new())
}

/// A scenario of a task with params, without a layout.
fn base(task: &str, params: &[(&str, f64)]) -> Scenario {
    let task = env_core::task(task).unwrap();
    Scenario::new(Recipe::with_params(task, params.iter().copied()).unwrap(), Seed::user(1).unwrap())
}

/// JSON of a deputy by its numbers in the order of the language.
fn deputy(numbers: [i32; 6]) -> Value {
    let [distance, azimuth_deg, elevation_deg, closing_speed, cross_speed, cross_deg] = numbers;
    json!({
        "distance": distance, "azimuth_deg": azimuth_deg, "elevation_deg": elevation_deg, "closing_speed": closing_speed,
        "cross_speed": cross_speed, "cross_deg": cross_deg,
    })
}

fn design(mode: &str, deputies: &[Value]) -> Value {
    json!({"name": "x", "aim": {"mode": mode}, "deputies": deputies})
}
