//! [`TaskingLanguage`]: the design language of tasking.

use std::collections::BTreeMap;

use env_core::admission::{SuccessRule, is_success};
use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;

use super::aim::allowed_aims;
use super::build::build_design;
use super::design::TaskingDesign;
use super::params::choices;
use super::{edit, novelty, picture, sample, schema, siblings, table};
use crate::brief::{DesignBrief, ParamChoice};
use crate::design_language::{DesignTable, LayoutKind, LayoutView, PromptTexts};
use crate::edit_direction::EditDirection;
use crate::field_error::FieldError;
use crate::refusal::{Refusal, RefusalWords};
use crate::world_language::WorldLanguage;

/// Design language of tasking.
#[derive(Debug, Clone, Copy)]
pub struct TaskingLanguage;

impl WorldLanguage for TaskingLanguage {
    type Design = TaskingDesign;

    const PROMPT: PromptTexts = PromptTexts {
        version: "tasking-2",
        system: include_str!("../../prompts/tasking-2/system.md"),
        unknown_failures: "The failures of the agent are unknown: vary aims, orbits, resources and fields.",
        profile_columns: "orbit angle in degrees (from local noon, sectors of 30) | - | -",
    };
    const WORDS: RefusalWords = RefusalWords {
        agents: "satellites",
        harmless: "a plan that gives no action succeeds; choose a harder start",
        solvable_fix: "choose more charge, slower wheels, or an earlier place in the sunlight",
        contested_fix: "choose less charge, or fields with more targets of different priorities",
        new_fix: "change the orbit, the resources or the fields",
    };

    fn from_json(design: &Value) -> Result<TaskingDesign, FieldError> {
        TaskingDesign::from_json(design)
    }

    fn to_json(design: &TaskingDesign) -> Value {
        design.to_json()
    }

    fn mode(design: &TaskingDesign) -> &str {
        &design.mode
    }

    fn params(design: &TaskingDesign) -> &BTreeMap<String, f64> {
        &design.params
    }

    fn allowed_modes(brief: &DesignBrief) -> Vec<&'static str> {
        allowed_aims(brief).map(|aim| aim.mode).collect()
    }

    fn param_choices(brief: &DesignBrief) -> Vec<&ParamChoice> {
        choices(brief)
    }

    fn is_design(value: &Value) -> bool {
        value.get("start").is_some() && value.get("aim").is_some()
    }

    fn build(design: &TaskingDesign, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal> {
        Ok((build_design(design, base)?.scenario, LayoutKind::Threat))
    }

    /// True if a satellite without tasks succeeds.
    fn is_harmless(scenario: &Scenario, bracket: &Bracket) -> bool {
        let succeeds = |hold| is_success(scenario, SuccessRule::Task, bracket, hold);
        bracket.panel.first().is_none_or(succeeds)
    }

    /// Always `Ok`: agents observe resources, eclipses and windows from the start.
    fn check_reaction(_: &Scenario) -> Result<(), FieldError> {
        Ok(())
    }

    fn distance(a: &TaskingDesign, b: &TaskingDesign) -> f64 {
        novelty::distance(a, b)
    }

    fn aim_place(design: &Value) -> Option<String> {
        let angle = design.pointer("/aim/orbit_angle_deg").and_then(Value::as_u64)?;
        Some(format!("at {angle} degrees from local noon"))
    }

    fn rules(brief: &DesignBrief) -> String {
        schema::rules(brief)
    }

    fn schema(brief: &DesignBrief) -> Value {
        schema::design_schema(brief)
    }

    fn sample(brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng) -> Option<TaskingDesign> {
        sample::sample_design(brief, base, rng)
    }

    fn edit(
        design: &TaskingDesign,
        brief: &DesignBrief,
        base: &Scenario,
        direction: Option<EditDirection>,
        rng: &mut KeyedRng,
    ) -> Option<TaskingDesign> {
        match direction {
            None => edit::edit_design(design, brief, base, rng),
            Some(direction) => siblings::edit_sibling(design, brief, base, direction, rng),
        }
    }

    fn table(design: &TaskingDesign) -> DesignTable {
        table::design_table(design)
    }

    fn draw(layout: LayoutView<'_>) -> String {
        picture::draw(layout)
    }
}
