//! What kessler is held to.

mod axes;
mod bad_input;
mod critique;
mod critique_laws;
mod critique_tasks;
mod differences;
mod fuzz;
mod golden;
mod judged_steps;
mod laws;
mod observed;
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
use crate::testing::at_level;

/// A scenario under `risk: pc` with these params, by a user's seed.
pub(super) fn at_risk(task: &str, params: &[(&str, f64)], seed: u64) -> Scenario {
    let recipe = Recipe::with_params(crate::task(task).unwrap(), params.iter().copied()).unwrap();
    Scenario::new(recipe.with_option("risk", "pc").unwrap(), Seed::user(seed).unwrap())
}
