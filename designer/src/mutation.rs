//! [`Mutation`]: a scenario after a few small edits; and edits of params that the languages of all worlds share.

use std::collections::BTreeMap;

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

/// Returns one of some choices, each as likely as the others; `None` if there are none.
pub(crate) fn pick_choice<'a>(choices: &[&'a ParamChoice], rng: &mut KeyedRng) -> Option<&'a ParamChoice> {
    let count = u32::try_from(choices.len()).ok().filter(|count| *count > 0)?;
    choices.get(rng.below(count) as usize).copied()
}

/// Sets one of the params of a design to one of its choices; without choices, nothing changes.
pub(crate) fn set_random_param(
    params: &mut BTreeMap<String, f64>,
    choices: &[&ParamChoice],
    rng: &mut KeyedRng,
) {
    let Some(choice) = pick_choice(choices, rng) else { return };
    let count = u32::try_from(choice.values.len()).unwrap_or(u32::MAX);
    if let Some(value) = choice.values.get(rng.below(count) as usize) {
        params.insert(choice.param.clone(), *value);
    }
}

/// Returns the next lower or higher allowed value of a param, chosen at random; `None` if there is none.
pub(crate) fn adjacent_value(recipe: &Recipe, choice: &ParamChoice, rng: &mut KeyedRng) -> Option<f64> {
    let current = recipe.param(&choice.param)?;
    let below = choice.values.iter().rev().find(|value| **value < current);
    let above = choice.values.iter().find(|value| **value > current);
    let (first, second) = if rng.bernoulli(0.5) { (below, above) } else { (above, below) };
    first.or(second).copied()
}
