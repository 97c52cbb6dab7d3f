//! Params that a design or an edit may set.

use env_core::Recipe;
use env_core::tasking::setup::environment::DEFAULT_STATIONS;

use crate::brief::{DesignBrief, ParamChoice};

/// Returns true if a param acts on what a design leaves open. The others only decide draws that a design replaces.
fn has_effect(param: &str) -> bool {
    !matches!(param, "charge_min" | "charge_max" | "storage_fill" | "wheel_rpm")
}

/// Returns the params that a design for a brief may choose.
pub(super) fn choices(brief: &DesignBrief) -> Vec<&ParamChoice> {
    brief.param_choices.iter().filter(|choice| has_effect(&choice.param)).collect()
}

/// Returns true if a recipe draws targets, so that a layout may have some.
pub(super) fn has_targets(recipe: &Recipe) -> bool {
    recipe.param("targets").is_some()
}

/// Returns the number of ground stations of a recipe; all known ones if no param limits it.
pub(super) fn station_count(recipe: &Recipe) -> usize {
    recipe.param("stations").map_or(DEFAULT_STATIONS.len(), |stations| stations as usize)
}
