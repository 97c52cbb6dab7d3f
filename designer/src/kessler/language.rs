//! [`KesslerLanguage`]: the design language of kessler.

use std::collections::BTreeMap;

use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;

use super::aim::{allowed_aims, allows_rogues, check_aim, has_threat};
use super::compile::compile;
use super::design::Design;
use super::vocabulary::FRAMES;
use super::{checks, edit, novelty, picture, sample, schema, siblings, table};
use crate::brief::DesignBrief;
use crate::design_language::{DesignTable, LayoutKind, LayoutView, PromptTexts};
use crate::edit_direction::EditDirection;
use crate::field_error::FieldError;
use crate::refusal::{Refusal, RefusalWords};
use crate::untrusted_text::identifier;
use crate::world_language::WorldLanguage;

/// Design language of kessler.
#[derive(Debug, Clone, Copy)]
pub struct KesslerLanguage;

impl WorldLanguage for KesslerLanguage {
    type Design = Design;

    const PROMPT: PromptTexts = PromptTexts {
        version: "kessler-3",
        system: include_str!("../../prompts/kessler-3/system.md"),
        unknown_failures: "The failures of the agent are unknown: vary aims, bearings, speeds and satellites.",
        profile_columns: "bearing in degrees (frame radial_in_track, sectors of 30) | relative speed | steps left to act",
    };
    const WORDS: RefusalWords = RefusalWords {
        agents: "satellites",
        harmless: "no satellite is lost if no satellite burns; add a threat that hits",
        solvable_fix: "choose fewer or later threats, or more fuel",
        contested_fix: "choose more threats, to more satellites",
        new_fix: "change bearings, steps or satellites",
    };

    fn from_json(design: &Value) -> Result<Design, FieldError> {
        Design::from_json(design)
    }

    fn to_json(design: &Design) -> Value {
        design.to_json()
    }

    fn mode(design: &Design) -> &str {
        &design.aim.mode
    }

    fn params(design: &Design) -> &BTreeMap<String, f64> {
        &design.params
    }

    fn allowed_modes(brief: &DesignBrief) -> Vec<&'static str> {
        allowed_aims(brief).map(|aim| aim.mode).collect()
    }

    /// A level without rogues allows none.
    fn check_brief(design: &Design, brief: &DesignBrief) -> Result<(), FieldError> {
        let rogue = design.encounters.iter().position(|encounter| encounter.is_rogue);
        rogue.filter(|_| !allows_rogues(brief)).map_or(Ok(()), |at| {
            Err(FieldError::new(format!("encounters.{at}.rogue"), "must be false: the level has no rogues"))
        })
    }

    fn is_design(value: &Value) -> bool {
        value.get("encounters").is_some()
    }

    fn build(design: &Design, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal> {
        let compiled = compile(design, base).map_err(Refusal::Compiles)?;
        check_aim(design, &compiled.placed).map_err(Refusal::Aim)?;
        let kind = if has_threat(design) { LayoutKind::Threat } else { LayoutKind::Decoy };
        Ok((compiled.scenario, kind))
    }

    fn is_harmless(_: &Scenario, bracket: &Bracket) -> bool {
        bracket.panel.first().is_none_or(|hold| hold.lost == 0)
    }

    fn check_reaction(scenario: &Scenario) -> Result<(), FieldError> {
        checks::check_visibility(scenario)
    }

    fn check_decoy(scenario: &Scenario, bracket: &Bracket) -> Result<(), FieldError> {
        checks::check_decoy(scenario, bracket)
    }

    fn distance(a: &Design, b: &Design) -> f64 {
        novelty::distance(a, b)
    }

    fn aim_place(design: &Value) -> Option<String> {
        let bearing = design.pointer("/aim/bearing_deg").and_then(Value::as_u64)?;
        let frame = design.get("frame").and_then(Value::as_str).unwrap_or(FRAMES[0].name);
        Some(format!("from {bearing} degrees ({})", identifier(frame)))
    }

    fn rules(brief: &DesignBrief) -> String {
        schema::rules(brief)
    }

    fn schema(brief: &DesignBrief) -> Value {
        schema::design_schema(brief)
    }

    fn sample(brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng) -> Option<Design> {
        sample::sample_design(brief, base, rng)
    }

    fn edit(
        design: &Design,
        brief: &DesignBrief,
        base: &Scenario,
        direction: Option<EditDirection>,
        rng: &mut KeyedRng,
    ) -> Option<Design> {
        match direction {
            None => edit::edit_design(design, brief, base, rng),
            Some(direction) => siblings::edit_sibling(design, brief, base, direction, rng),
        }
    }

    fn table(design: &Design) -> DesignTable {
        table::design_table(design)
    }

    fn draw(layout: LayoutView<'_>) -> String {
        picture::draw(layout)
    }
}
