//! [`Mutation`]: a scenario after a few small edits.

use env_core::{KeyedRng, Recipe, Scenario};

use crate::brief::ParamChoice;

/// Scenario after a few small edits.
#[derive(Debug, Clone, PartialEq)]
pub struct Mutation {
    /// Scenario after the edits.
    pub scenario: Scenario,
    /// Names of the edits, in order.
    pub changes: Vec<&'static str>,
}

/// Returns the next lower or higher allowed value of a param, chosen at random; `None` if there is none.
pub(crate) fn adjacent_value(recipe: &Recipe, choice: &ParamChoice, rng: &mut KeyedRng) -> Option<f64> {
    let current = recipe.param(&choice.param)?;
    let below = choice.values.iter().rev().find(|value| **value < current);
    let above = choice.values.iter().find(|value| **value > current);
    let (first, second) = if rng.bernoulli(0.5) { (below, above) } else { (above, below) };
    first.or(second).copied()
}
