//! What docking is held to.

mod critique;
mod golden;
mod input;
mod laws;
mod levels;
mod motion;
mod reference;

use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;

/// A scenario of a task at a level, by a user's seed.
fn at_level(task: &str, level: usize, seed: u64) -> Scenario {
    let task = crate::task(task).unwrap();
    let recipe = Recipe::with_params(task, task.levels().params(level)).unwrap();
    Scenario::new(recipe, Seed::user(seed).unwrap())
}
