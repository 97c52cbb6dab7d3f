//! What kessler is held to.

mod bad_input;
mod critique;
mod critique_laws;
mod critique_tasks;
mod differences;
mod fuzz;
mod golden;
mod laws;
mod planned;
mod planned_at_risk;
mod reference;
mod staging;
mod tracks;
mod validate_formation;
mod validate_j2;
mod validate_pc;
mod validate_swept;
mod validate_warnings;

use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;

/// A scenario of a task at a level, by a user's seed.
fn at_level(task: &str, level: usize, seed: u64) -> Scenario {
    let task = crate::task(task).unwrap();
    let recipe = Recipe::with_params(task, task.levels().params(level)).unwrap();
    Scenario::new(recipe, Seed::user(seed).unwrap())
}

/// A scenario under `risk: pc` with these params, by a user's seed.
pub(super) fn at_risk(task: &str, params: &[(&str, f64)], seed: u64) -> Scenario {
    let recipe = Recipe::with_params(crate::task(task).unwrap(), params.iter().copied()).unwrap();
    Scenario::new(recipe.with_option("risk", "pc").unwrap(), Seed::user(seed).unwrap())
}
