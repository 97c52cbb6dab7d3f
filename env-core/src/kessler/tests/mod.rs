//! Tests of kessler: unit tests of constructed cases, property tests (`*_laws`, `fuzz`), golden hashes, and
//! validations against formulas and recordings (`validate_*`, `reference`).

mod agent_axes;
mod bad_input;
mod batch_observations;
mod critique;
mod critique_laws;
mod critique_tasks;
mod episode_laws;
mod fuzz;
mod golden;
mod planner_at_risk;
mod planner_laws;
mod reference;
mod staging;
mod start_rungs;
mod step_judgements;
mod tracks;
mod upstream_differences;
mod validate_formation;
mod validate_j2;
mod validate_pc;
mod validate_swept;
mod validate_warnings;

use crate::seed::Seed;
use crate::task::{Recipe, Scenario};
use crate::testing::at_level;

/// Scenario under `risk: pc` with these params and a user seed.
pub(super) fn scenario_at_risk(task: &str, params: &[(&str, f64)], seed: u64) -> Scenario {
    let recipe = Recipe::with_params(crate::task(task).unwrap(), params.iter().copied()).unwrap();
    Scenario::new(recipe.with_option("risk", "pc").unwrap(), Seed::user(seed).unwrap())
}
