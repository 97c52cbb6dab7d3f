//! [`TaskingLanguage`]: the design language of tasking.

use env_core::admission::{SuccessRule, is_success};
use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;

use super::aim::allowed_aims;
use super::build::build_design;
use super::design::TaskingDesign;
use super::params::choices;
use super::{edit, novelty, picture, sample, schema, table};
use crate::brief::{DesignBrief, ParamChoice};
use crate::design_fields::{check_mode, check_params};
use crate::design_language::{DesignLanguage, DesignTable, LayoutKind, LayoutView, PromptTexts};
use crate::field_error::FieldError;
use crate::refusal::{Refusal, RefusalWords};

/// Design language of tasking.
#[derive(Debug, Clone, Copy)]
pub struct TaskingLanguage;

/// Texts of the prompts.
const PROMPT: PromptTexts = PromptTexts {
    version: "tasking-1",
    system: include_str!("../../prompts/tasking-1/system.md"),
    unknown_failures: "The failures of the agent are unknown: vary aims, orbits, resources and fields.",
    profile_columns: "orbit angle in degrees (from local noon, sectors of 30) | - | -",
};

/// Words of tasking in refusals.
const WORDS: RefusalWords = RefusalWords {
    agents: "satellites",
    harmless: "a plan that gives no action succeeds; choose a harder start",
    solvable_fix: "choose more charge, slower wheels, or an earlier place in the sunlight",
    contested_fix: "choose less charge, or fields with more targets of different priorities",
    new_fix: "change the orbit, the resources or the fields",
};

impl DesignLanguage for TaskingLanguage {
    fn prompt_texts(&self) -> &'static PromptTexts {
        &PROMPT
    }

    fn refusal_words(&self) -> &'static RefusalWords {
        &WORDS
    }

    fn param_choices<'a>(&self, brief: &'a DesignBrief) -> Vec<&'a ParamChoice> {
        choices(brief)
    }

    fn rules(&self, brief: &DesignBrief) -> String {
        schema::rules(brief)
    }

    fn schema(&self, brief: &DesignBrief) -> Value {
        schema::design_schema(brief)
    }

    fn is_design(&self, value: &Value) -> bool {
        value.get("start").is_some() && value.get("aim").is_some()
    }

    fn parse(&self, design: &Value, brief: &DesignBrief) -> Result<Value, FieldError> {
        parse_for(design, brief).map(|design| design.to_json())
    }

    fn build(&self, design: &Value, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal> {
        let design = TaskingDesign::from_json(design).map_err(Refusal::Schema)?;
        let compiled = build_design(&design, base)?;
        Ok((compiled.scenario, LayoutKind::Threat))
    }

    /// True if a satellite without tasks succeeds.
    fn is_harmless(&self, scenario: &Scenario, bracket: &Bracket) -> bool {
        let succeeds = |hold| is_success(scenario, SuccessRule::Task, bracket, hold);
        bracket.panel.first().is_none_or(succeeds)
    }

    /// Always `Ok`: agents observe resources, eclipses and windows from the start.
    fn check_reaction(&self, _: &Scenario) -> Result<(), FieldError> {
        Ok(())
    }

    fn distance(&self, a: &Value, b: &Value) -> f64 {
        match (TaskingDesign::from_json(a), TaskingDesign::from_json(b)) {
            (Ok(a), Ok(b)) => novelty::distance(&a, &b),
            _ => 1.0, // an invalid design is similar to none
        }
    }

    fn sample(&self, brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng) -> Option<Value> {
        sample::sample_design(brief, base, rng).map(|design| design.to_json())
    }

    fn edit(
        &self,
        design: &Value,
        brief: &DesignBrief,
        base: &Scenario,
        rng: &mut KeyedRng,
    ) -> Option<Value> {
        let design = parse_for(design, brief).ok()?;
        edit::edit_design(&design, brief, base, rng).map(|design| design.to_json())
    }

    fn aim_place(&self, design: &Value) -> Option<String> {
        let angle = design.pointer("/aim/orbit_angle_deg").and_then(Value::as_u64)?;
        Some(format!("at {angle} degrees from local noon"))
    }

    fn table(&self, design: &Value) -> Option<DesignTable> {
        TaskingDesign::from_json(design).ok().map(|design| table::design_table(&design))
    }

    fn draw(&self, layout: LayoutView<'_>) -> String {
        picture::draw(layout)
    }
}

/// Parses a design, and checks that the brief allows its aim and params.
fn parse_for(design: &Value, brief: &DesignBrief) -> Result<TaskingDesign, FieldError> {
    let design = TaskingDesign::from_json(design)?;
    let modes: Vec<_> = allowed_aims(brief).map(|aim| aim.mode).collect();
    check_mode(&design.mode, &modes)?;
    check_params(&design.params, brief, &choices(brief))?;
    Ok(design)
}
