//! [`KesslerLanguage`]: the design language of kessler.

use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;

use super::aim::{allowed_aims, allows_rogues, check_aim, has_threat};
use super::compile::compile;
use super::design::Design;
use super::vocabulary::FRAMES;
use super::{checks, edit, novelty, picture, sample, schema, table};
use crate::brief::DesignBrief;
use crate::design_fields::{check_mode, check_params};
use crate::design_language::{DesignLanguage, DesignTable, LayoutKind, LayoutView, PromptTexts};
use crate::field_error::FieldError;
use crate::refusal::{Refusal, RefusalWords};
use crate::untrusted_text::identifier;

/// Design language of kessler.
#[derive(Debug, Clone, Copy)]
pub struct KesslerLanguage;

/// Texts of the world's prompts.
const PROMPT: PromptTexts = PromptTexts {
    version: "kessler-2",
    system: include_str!("../../prompts/kessler-2/system.md"),
    unknown_failures: "The failures of the agent are unknown: vary aims, bearings, speeds and satellites.",
    profile_columns: "bearing in degrees (frame radial_in_track, sectors of 30) | relative speed | steps left to act",
};

/// Words of the world in refusals.
const WORDS: RefusalWords = RefusalWords {
    agents: "satellites",
    harmless: "no satellite is lost if no satellite burns; add a threat that hits",
    solvable_fix: "choose fewer or later threats, or more fuel",
    contested_fix: "choose more threats, to more satellites",
    new_fix: "change bearings, steps or satellites",
};

impl DesignLanguage for KesslerLanguage {
    fn prompt_texts(&self) -> &'static PromptTexts {
        &PROMPT
    }

    fn refusal_words(&self) -> &'static RefusalWords {
        &WORDS
    }

    fn rules(&self, brief: &DesignBrief) -> String {
        schema::rules(brief)
    }

    fn schema(&self, brief: &DesignBrief) -> Value {
        schema::design_schema(brief)
    }

    fn is_design(&self, value: &Value) -> bool {
        value.get("encounters").is_some()
    }

    fn parse(&self, design: &Value, brief: &DesignBrief) -> Result<Value, FieldError> {
        parse_for(design, brief).map(|design| design.to_json())
    }

    fn build(&self, design: &Value, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal> {
        let design = Design::from_json(design).map_err(Refusal::Schema)?;
        let compiled = compile(&design, base).map_err(Refusal::Compiles)?;
        check_aim(&design, &compiled.placed).map_err(Refusal::Aim)?;
        let kind = if has_threat(&design) { LayoutKind::Threat } else { LayoutKind::Decoy };
        Ok((compiled.scenario, kind))
    }

    fn is_harmless(&self, _: &Scenario, bracket: &Bracket) -> bool {
        bracket.panel.first().is_none_or(|hold| hold.lost == 0)
    }

    fn check_reaction(&self, scenario: &Scenario) -> Result<(), FieldError> {
        checks::check_visibility(scenario)
    }

    fn check_decoy(&self, scenario: &Scenario, bracket: &Bracket) -> Result<(), FieldError> {
        checks::check_decoy(scenario, bracket)
    }

    fn distance(&self, a: &Value, b: &Value) -> f64 {
        match (Design::from_json(a), Design::from_json(b)) {
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
        let bearing = design.pointer("/aim/bearing_deg").and_then(Value::as_u64)?;
        let frame = design.get("frame").and_then(Value::as_str).unwrap_or(FRAMES[0].name);
        Some(format!("from {bearing} degrees ({})", identifier(frame)))
    }

    fn table(&self, design: &Value) -> Option<DesignTable> {
        Design::from_json(design).ok().map(|design| table::design_table(&design))
    }

    fn draw(&self, layout: LayoutView<'_>) -> String {
        picture::draw(layout)
    }
}

/// Parses a design, and checks that the brief allows its aim, params and rogues.
fn parse_for(design: &Value, brief: &DesignBrief) -> Result<Design, FieldError> {
    let design = Design::from_json(design)?;
    check_mode(&design.aim.mode, &allowed_aims(brief).map(|aim| aim.mode).collect::<Vec<_>>())?;
    check_params(&design.params, brief, &KesslerLanguage.param_choices(brief))?;
    if let Some(at) = design.encounters.iter().position(|e| e.is_rogue).filter(|_| !allows_rogues(brief)) {
        return Err(FieldError::new(
            format!("encounters.{at}.rogue"),
            "must be false: the level has no rogues",
        ));
    }
    Ok(design)
}
