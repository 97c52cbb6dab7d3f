//! Worlds that can be designed for or mutated, by task.

use env_core::{KeyedRng, Scenario, TaskSpec};
use serde_json::json;

use crate::brief::DesignBrief;
use crate::design_language::{DesignLanguage, LayoutView};
use crate::mutation::Mutation;
use crate::{docking, kessler, tasking};

/// Returns the design language of a task's world; `None` if the world cannot be designed for.
#[must_use]
pub fn design_language(task: &dyn TaskSpec) -> Option<&'static dyn DesignLanguage> {
    match world_name(task) {
        "docking" => Some(&docking::DockingLanguage),
        "kessler" => Some(&kessler::KesslerLanguage),
        "tasking" => Some(&tasking::TaskingLanguage),
        _ => None,
    }
}

/// Draws a layout as a standalone SVG document, about 900 units wide; `None` if the world cannot be designed for.
#[must_use]
pub fn draw_layout(layout: LayoutView<'_>) -> Option<String> {
    design_language(layout.scenario.task()).map(|language| language.draw(layout))
}

/// Makes a few small random edits to a scenario; `None` if no edit fits.
///
/// Curricula edit scenarios at the edge of an agent's ability to find more of them (ACCEL, Parker-Holder et al. 2022). The
/// brief is for the parent's task, without a layout, at the level from which the parent or its first ancestor was drawn. The
/// result is a valid scenario, but it has not passed the gate. Its layout names its parent and the edits as provenance.
#[must_use]
pub fn mutate(parent: &Scenario, brief: &DesignBrief, rng: &mut KeyedRng) -> Option<Mutation> {
    let mutation = match world_name(parent.task()) {
        "kessler" => kessler::mutate(parent, brief, rng),
        "docking" => docking::mutate(parent, brief, rng),
        "tasking" => tasking::mutate(parent, brief, rng),
        _ => None,
    }?;
    let mut layout = mutation.scenario.recipe().layout()?.clone();
    layout.provenance = Some(json!({"edit_of": parent.id().to_string(), "changes": mutation.changes}));
    let recipe = mutation.scenario.recipe().as_ref().clone().with_layout(Some(layout)).ok()?;
    Some(Mutation { scenario: Scenario::new(recipe, mutation.scenario.seed()), ..mutation })
}

/// Name of a task's world without its version, such as `kessler`.
fn world_name(task: &dyn TaskSpec) -> &str {
    let world = task.world();
    world.split_once('@').map_or(world, |(name, _)| name)
}
