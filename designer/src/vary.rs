//! A scenario with a few small things changed: what a curriculum edits (ACCEL, Parker-Holder et al. 2022) so that scenarios at
//! the edge of what an agent can do lead to others that are there, too.

use env_core::{Draws, Recipe, Scenario};
use serde_json::json;

use crate::brief::{Brief, Limit};

/// A scenario that was edited.
#[derive(Debug, Clone, PartialEq)]
pub struct Varied {
    /// As it is now.
    pub scenario: Scenario,
    /// What was changed, each in a word.
    pub changes: Vec<&'static str>,
}

/// A scenario with a few small things changed. The brief is for its task, without a layout, at the level that the scenario, or
/// what it was edited from, was drawn at. None where nothing suits; what is given has not passed any check but that it can be read.
#[must_use]
pub fn vary(parent: &Scenario, brief: &Brief, draws: &mut Draws) -> Option<Varied> {
    let varied = match parent.task().world().split('@').next() {
        Some("kessler") => crate::kessler::vary(parent, brief, draws),
        Some("docking") => crate::docking::vary(parent, brief, draws),
        _ => None,
    }?;
    // The lineage goes with the layout, wherever that goes.
    let mut layout = varied.scenario.recipe().layout()?.clone();
    layout.provenance = Some(json!({"edit_of": parent.id().to_string(), "changes": varied.changes}));
    let recipe = varied.scenario.recipe().as_ref().clone().with_layout(Some(layout)).ok()?;
    Some(Varied { scenario: Scenario::new(recipe, varied.scenario.seed()), ..varied })
}

/// One step up or down of a param among those it may take; none where it has none to go to.
pub(crate) fn beside(recipe: &Recipe, limit: &Limit, draws: &mut Draws) -> Option<f64> {
    let now = recipe.param(&limit.param)?;
    let below = limit.values.iter().rev().find(|value| **value < now);
    let above = limit.values.iter().find(|value| **value > now);
    let (first, second) = if draws.chance(0.5) { (below, above) } else { (above, below) };
    first.or(second).copied()
}
