//! Compiles a design into a scenario. Its layout contains the state of every deputy, so that it is the same under every seed.

use std::collections::BTreeMap;

use env_core::task::LayoutMode;
use env_core::{Layout, Recipe, Scenario, ScenarioError};

use super::design::DockingDesign;
use crate::field_error::FieldError;

/// Param that is the number of deputies; a task without it has one.
const DEPUTIES_PARAM: &str = "deputies";

/// Compiles a design in a base scenario, which gives task, options, seed and the remaining params. Its layout is ignored.
///
/// # Errors
/// Returns an error with the first deputy or param that the task does not accept.
pub fn compile(design: &DockingDesign, base: &Scenario) -> Result<Scenario, FieldError> {
    let recipe = recipe_of(design, base).map_err(field_error)?;
    let agents = recipe.task().agents(&recipe) as usize;
    if agents != design.deputies.len() {
        let message = format!("must have {agents} entries in this task, got {}", design.deputies.len());
        return Err(FieldError::new("deputies", message));
    }
    let rows = design.deputies.iter().map(|deputy| deputy.state().to_vec()).collect();
    let layout = Layout {
        mode: LayoutMode::Replace,
        bodies: BTreeMap::from([("deputies".to_owned(), rows)]),
        provenance: Some(design.to_json()),
    };
    let recipe = recipe.with_layout(Some(layout)).map_err(field_error)?;
    Ok(Scenario::new(recipe, base.seed()))
}

/// Returns the recipe of a base scenario with the params and the number of deputies of a design.
fn recipe_of(design: &DockingDesign, base: &Scenario) -> Result<Recipe, ScenarioError> {
    let mut recipe = base.recipe().as_ref().clone().with_layout(None)?;
    for (name, value) in &design.params {
        recipe = recipe.with_param(name, *value)?;
    }
    if recipe.param(DEPUTIES_PARAM).is_some() {
        recipe = recipe.with_param(DEPUTIES_PARAM, design.deputies.len() as f64)?;
    }
    Ok(recipe)
}

/// Returns an error of a scenario with the field of the design that causes it.
#[expect(clippy::needless_pass_by_value, reason = "the signature that map_err takes")]
fn field_error(error: ScenarioError) -> FieldError {
    let field = error.field();
    FieldError::new(field.strip_prefix("layout.bodies.").unwrap_or(field).to_owned(), error.reason())
}
