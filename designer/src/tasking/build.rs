//! Builds a design in a base scenario, and checks its aim.

use env_core::Scenario;

use super::aim::check_aim;
use super::compile::{CompiledStart, compile};
use super::design::TaskingDesign;
use super::facts::DesignFacts;
use super::params::has_targets;
use crate::refusal::Refusal;

/// Compiles a design and checks its aim.
///
/// # Errors
/// Returns [`Refusal::Compiles`] if the task does not allow a part of it, and [`Refusal::Aim`] if it does not match its aim.
pub(super) fn build_design(design: &TaskingDesign, base: &Scenario) -> Result<CompiledStart, Refusal> {
    let compiled = compile(design, base).map_err(Refusal::Compiles)?;
    let has_targets = has_targets(base.recipe());
    check_aim(&DesignFacts { design, forecast: &compiled.forecast, has_targets }).map_err(Refusal::Aim)?;
    Ok(compiled)
}
