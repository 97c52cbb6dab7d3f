//! [`KesslerLanguage`]: the design language of kessler.

use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario, format_shortest};
use serde_json::Value;

use super::aim::{allowed_aims, allows_rogues, check_aim, has_threat};
use super::compile::compile;
use super::design::Design;
use super::{checks, edit, novelty, picture, sample, schema, table};
use crate::brief::DesignBrief;
use crate::design_language::{DesignLanguage, DesignTable, LayoutKind, LayoutView};
use crate::field_error::FieldError;
use crate::refusal::Refusal;
use crate::untrusted_text::shorten;

/// Design language of kessler.
#[derive(Debug, Clone, Copy)]
pub struct KesslerLanguage;

impl DesignLanguage for KesslerLanguage {
    fn rules(&self, brief: &DesignBrief) -> String {
        schema::rules(brief)
    }

    fn schema(&self, brief: &DesignBrief) -> Value {
        schema::design_schema(brief)
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

    fn check_visibility(&self, scenario: &Scenario) -> Result<(), FieldError> {
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
    if !allowed_aims(brief).any(|aim| aim.mode == design.aim.mode) {
        let known = allowed_aims(brief).map(|aim| aim.mode).collect::<Vec<_>>().join(", ");
        let mode = shorten(&design.aim.mode);
        return Err(FieldError::new(
            "aim.mode",
            format!("must be one of {known} for this brief, got {mode:?}"),
        ));
    }
    for (name, value) in &design.params {
        check_param(name, *value, brief)?;
    }
    if let Some(at) = design.encounters.iter().position(|e| e.is_rogue).filter(|_| !allows_rogues(brief)) {
        return Err(FieldError::new(
            format!("encounters.{at}.rogue"),
            "must be false: the level has no rogues",
        ));
    }
    Ok(design)
}

/// Checks that a param has the value of the brief's recipe, or is one of the brief's choices.
fn check_param(name: &str, value: f64, brief: &DesignBrief) -> Result<(), FieldError> {
    if brief.recipe.param(name).is_some_and(|held| held.to_bits() == value.to_bits()) {
        return Ok(());
    }
    let field = format!("params.{name}");
    let Some(choice) = brief.param_choices.iter().find(|choice| choice.param == *name) else {
        let known = brief.param_choices.iter().map(|choice| choice.param.as_str());
        let known = known.collect::<Vec<_>>().join(", ");
        let message = if known.is_empty() {
            "must be left out: all params are fixed".to_owned()
        } else {
            format!("must be left out: a layout may set only {known}")
        };
        return Err(FieldError::new(field, message));
    };
    if choice.values.contains(&value) {
        return Ok(());
    }
    let values = choice.values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    Err(FieldError::new(field, format!("must be one of {values}, got {}", format_shortest(value))))
}
