//! [`DockingLanguage`]: the design language of docking.

use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;

use super::aim::{DeputyCounts, allowed_aims};
use super::design::DockingDesign;
use super::vocabulary::effective_choices;
use super::{checks, edit, novelty, picture, sample, schema, table};
use crate::brief::{DesignBrief, ParamChoice};
use crate::design_fields::{check_mode, check_params};
use crate::design_language::{DesignLanguage, DesignTable, LayoutKind, LayoutView, PromptTexts};
use crate::field_error::FieldError;
use crate::refusal::{Refusal, RefusalWords};

/// Design language of docking. It has threats only: an agent that does nothing never docks.
#[derive(Debug, Clone, Copy)]
pub struct DockingLanguage;

/// Texts of the world's prompts.
const PROMPT: PromptTexts = PromptTexts {
    version: "docking-1",
    system: include_str!("../../prompts/docking-1/system.md"),
    unknown_failures: "The failures of the agent are unknown: vary aims, distances, directions and speeds.",
    profile_columns: "bearing in degrees from the deputy to what it hit (0 radial out, 90 in-track, sectors of 30) | relative speed | \
                      steps left to act",
};

/// Words of the world in refusals.
const WORDS: RefusalWords = RefusalWords {
    agents: "deputies",
    harmless: "a deputy docks without any thrust; choose a cross speed, or a closing speed that is not aimed at the chief",
    solvable_fix: "choose smaller distances, lower speeds, deputies farther apart, more time or more thrust",
    contested_fix: "choose a harder start",
    new_fix: "change distances, directions or speeds",
};

impl DesignLanguage for DockingLanguage {
    fn prompt_texts(&self) -> &'static PromptTexts {
        &PROMPT
    }

    fn refusal_words(&self) -> &'static RefusalWords {
        &WORDS
    }

    fn param_choices<'a>(&self, brief: &'a DesignBrief) -> Vec<&'a ParamChoice> {
        effective_choices(brief)
    }

    fn rules(&self, brief: &DesignBrief) -> String {
        schema::rules(brief)
    }

    fn schema(&self, brief: &DesignBrief) -> Value {
        schema::design_schema(brief)
    }

    fn is_design(&self, value: &Value) -> bool {
        value.get("deputies").is_some()
    }

    fn parse(&self, design: &Value, brief: &DesignBrief) -> Result<Value, FieldError> {
        parse_for(design, brief).map(|design| design.to_json())
    }

    fn build(&self, design: &Value, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal> {
        let design = DockingDesign::from_json(design).map_err(Refusal::Schema)?;
        Ok((checks::build(&design, base)?, LayoutKind::Threat))
    }

    /// A plan of the panel, which ignores all observations, must not dock a single deputy.
    fn is_harmless(&self, _: &Scenario, bracket: &Bracket) -> bool {
        bracket.panel.iter().any(|outcome| outcome.goal.is_some_and(|docked| docked > 0.0))
    }

    fn check_reaction(&self, scenario: &Scenario) -> Result<(), FieldError> {
        checks::check_reaction(scenario)
    }

    fn distance(&self, a: &Value, b: &Value) -> f64 {
        match (DockingDesign::from_json(a), DockingDesign::from_json(b)) {
            (Ok(a), Ok(b)) => novelty::design_distance(&a, &b),
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
        let bearing = design.pointer("/aim/bearing_deg").and_then(Value::as_u64)?;
        Some(format!("from {bearing} degrees"))
    }

    fn table(&self, design: &Value) -> Option<DesignTable> {
        DockingDesign::from_json(design).ok().map(|design| table::design_table(&design))
    }

    fn draw(&self, layout: LayoutView<'_>) -> String {
        picture::draw(layout)
    }
}

/// Parses a design, and checks that the brief allows its aim, params and number of deputies.
fn parse_for(design: &Value, brief: &DesignBrief) -> Result<DockingDesign, FieldError> {
    let design = DockingDesign::from_json(design)?;
    check_mode(&design.aim.mode, &allowed_aims(brief).map(|aim| aim.mode).collect::<Vec<_>>())?;
    check_params(&design.params, brief, &effective_choices(brief))?;
    let counts = DeputyCounts::of(brief);
    if counts.contains(design.deputies.len()) {
        return Ok(design);
    }
    let DeputyCounts { min, max } = counts;
    let allowed = if min == max { min.to_string() } else { format!("{min} to {max}") };
    let message = format!("must have {allowed} entries for this brief, got {}", design.deputies.len());
    Err(FieldError::new("deputies", message))
}
