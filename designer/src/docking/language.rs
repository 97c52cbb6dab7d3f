//! [`DockingLanguage`]: the design language of docking.

use std::collections::BTreeMap;

use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;

use super::aim::{DeputyCounts, allowed_aims};
use super::design::DockingDesign;
use super::vocabulary::effective_choices;
use super::{checks, edit, novelty, picture, sample, schema, siblings, table};
use crate::brief::{DesignBrief, ParamChoice};
use crate::design_language::{DesignTable, LayoutKind, LayoutView, PromptTexts};
use crate::edit_direction::EditDirection;
use crate::field_error::FieldError;
use crate::refusal::{Refusal, RefusalWords};
use crate::world_language::WorldLanguage;

/// Design language of docking. It has threats only: an agent that does nothing never docks.
#[derive(Debug, Clone, Copy)]
pub struct DockingLanguage;

impl WorldLanguage for DockingLanguage {
    type Design = DockingDesign;

    const PROMPT: PromptTexts = PromptTexts {
        version: "docking-2",
        system: include_str!("../../prompts/docking-2/system.md"),
        unknown_failures: "The failures of the agent are unknown: vary aims, distances, directions and speeds.",
        profile_columns: "bearing in degrees from the deputy to what it hit (0 radial out, 90 in-track, sectors of 30) | relative speed | \
                          steps left to act",
    };
    const WORDS: RefusalWords = RefusalWords {
        agents: "deputies",
        harmless: "a deputy docks without any thrust; choose a cross speed, or a closing speed that is not aimed at the chief",
        solvable_fix: "choose smaller distances, lower speeds, deputies farther apart, more time or more thrust",
        contested_fix: "choose a harder start",
        new_fix: "change distances, directions or speeds",
    };

    fn from_json(design: &Value) -> Result<DockingDesign, FieldError> {
        DockingDesign::from_json(design)
    }

    fn to_json(design: &DockingDesign) -> Value {
        design.to_json()
    }

    fn mode(design: &DockingDesign) -> &str {
        &design.aim.mode
    }

    fn params(design: &DockingDesign) -> &BTreeMap<String, f64> {
        &design.params
    }

    fn allowed_modes(brief: &DesignBrief) -> Vec<&'static str> {
        allowed_aims(brief).map(|aim| aim.mode).collect()
    }

    fn param_choices(brief: &DesignBrief) -> Vec<&ParamChoice> {
        effective_choices(brief)
    }

    /// The brief sets the number of deputies.
    fn check_brief(design: &DockingDesign, brief: &DesignBrief) -> Result<(), FieldError> {
        let counts = DeputyCounts::of(brief);
        if counts.contains(design.deputies.len()) {
            return Ok(());
        }
        let DeputyCounts { min, max } = counts;
        let allowed = if min == max { min.to_string() } else { format!("{min} to {max}") };
        let message = format!("must have {allowed} entries for this brief, got {}", design.deputies.len());
        Err(FieldError::new("deputies", message))
    }

    fn is_design(value: &Value) -> bool {
        value.get("deputies").is_some()
    }

    fn build(design: &DockingDesign, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal> {
        Ok((checks::build(design, base)?, LayoutKind::Threat))
    }

    /// A plan of the panel, which ignores all observations, must not dock a single deputy.
    fn is_harmless(_: &Scenario, bracket: &Bracket) -> bool {
        bracket.panel.iter().any(|outcome| outcome.goal.is_some_and(|docked| docked > 0.0))
    }

    fn check_reaction(scenario: &Scenario) -> Result<(), FieldError> {
        checks::check_reaction(scenario)
    }

    fn distance(a: &DockingDesign, b: &DockingDesign) -> f64 {
        novelty::design_distance(a, b)
    }

    fn aim_place(design: &Value) -> Option<String> {
        let bearing = design.pointer("/aim/bearing_deg").and_then(Value::as_u64)?;
        Some(format!("from {bearing} degrees"))
    }

    fn rules(brief: &DesignBrief) -> String {
        schema::rules(brief)
    }

    fn schema(brief: &DesignBrief) -> Value {
        schema::design_schema(brief)
    }

    fn sample(brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng) -> Option<DockingDesign> {
        sample::sample_design(brief, base, rng)
    }

    fn edit(
        design: &DockingDesign,
        brief: &DesignBrief,
        base: &Scenario,
        direction: Option<EditDirection>,
        rng: &mut KeyedRng,
    ) -> Option<DockingDesign> {
        match direction {
            None => edit::edit_design(design, brief, base, rng),
            Some(direction) => siblings::edit_sibling(design, brief, base, direction, rng),
        }
    }

    fn table(design: &DockingDesign) -> DesignTable {
        table::design_table(design)
    }

    fn draw(layout: LayoutView<'_>) -> String {
        picture::draw(layout)
    }
}
