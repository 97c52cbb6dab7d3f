//! [`WorldLanguage`]: the parts of one world's design language, in terms of its parsed designs.
//!
//! A world implements this trait, and thereby [`DesignLanguage`], whose designs are JSON.

use std::collections::BTreeMap;

use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;

use crate::brief::{DesignBrief, ParamChoice};
use crate::design_fields::{check_mode, check_params};
use crate::design_language::{DesignLanguage, DesignTable, LayoutKind, LayoutView, PromptTexts};
use crate::edit_direction::EditDirection;
use crate::field_error::FieldError;
use crate::refusal::{Refusal, RefusalWords};

/// Design language of one world. Functions without a description are those of [`DesignLanguage`], for parsed designs.
pub(crate) trait WorldLanguage: Sync {
    /// Design of the world, parsed.
    type Design;

    /// Texts of the world's prompts.
    const PROMPT: PromptTexts;
    /// Words of the world in refusals.
    const WORDS: RefusalWords;

    /// Parses a design, without a brief.
    fn from_json(design: &Value) -> Result<Self::Design, FieldError>;

    /// JSON form of a design, which is canonical.
    fn to_json(design: &Self::Design) -> Value;

    /// Failure mode at which a design aims.
    fn mode(design: &Self::Design) -> &str;

    /// Params that a design sets, by name.
    fn params(design: &Self::Design) -> &BTreeMap<String, f64>;

    /// Failure modes at which designs for a brief may aim.
    fn allowed_modes(brief: &DesignBrief) -> Vec<&'static str>;

    /// Checks what else the brief demands of a design; by default nothing.
    fn check_brief(_: &Self::Design, _: &DesignBrief) -> Result<(), FieldError> {
        Ok(())
    }

    /// By default every param of the brief has an effect.
    fn param_choices(brief: &DesignBrief) -> Vec<&ParamChoice> {
        brief.param_choices.iter().collect()
    }

    fn rules(brief: &DesignBrief) -> String;
    fn schema(brief: &DesignBrief) -> Value;
    fn is_design(value: &Value) -> bool;
    fn build(design: &Self::Design, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal>;
    fn is_harmless(scenario: &Scenario, bracket: &Bracket) -> bool;
    fn check_reaction(scenario: &Scenario) -> Result<(), FieldError>;

    /// By default the world has no decoys.
    fn check_decoy(_: &Scenario, _: &Bracket) -> Result<(), FieldError> {
        Err(FieldError::new("aim.mode", "must be another one: the world has no decoys"))
    }

    fn distance(a: &Self::Design, b: &Self::Design) -> f64;
    fn sample(brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng) -> Option<Self::Design>;
    fn edit(
        design: &Self::Design,
        brief: &DesignBrief,
        base: &Scenario,
        direction: Option<EditDirection>,
        rng: &mut KeyedRng,
    ) -> Option<Self::Design>;
    fn aim_place(design: &Value) -> Option<String>;
    fn table(design: &Self::Design) -> DesignTable;
    fn draw(layout: LayoutView<'_>) -> String;
}

/// Parses a design, and checks that the brief allows it.
fn parse_for<L: WorldLanguage>(design: &Value, brief: &DesignBrief) -> Result<L::Design, FieldError> {
    let design = L::from_json(design)?;
    check_mode(L::mode(&design), &L::allowed_modes(brief))?;
    check_params(L::params(&design), brief, &L::param_choices(brief))?;
    L::check_brief(&design, brief)?;
    Ok(design)
}

impl<L: WorldLanguage> DesignLanguage for L {
    fn prompt_texts(&self) -> &'static PromptTexts {
        &L::PROMPT
    }

    fn refusal_words(&self) -> &'static RefusalWords {
        &L::WORDS
    }

    fn param_choices<'a>(&self, brief: &'a DesignBrief) -> Vec<&'a ParamChoice> {
        L::param_choices(brief)
    }

    fn rules(&self, brief: &DesignBrief) -> String {
        L::rules(brief)
    }

    fn schema(&self, brief: &DesignBrief) -> Value {
        L::schema(brief)
    }

    fn is_design(&self, value: &Value) -> bool {
        L::is_design(value)
    }

    fn parse(&self, design: &Value, brief: &DesignBrief) -> Result<Value, FieldError> {
        parse_for::<L>(design, brief).map(|design| L::to_json(&design))
    }

    fn build(&self, design: &Value, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal> {
        L::build(&L::from_json(design).map_err(Refusal::Schema)?, base)
    }

    fn is_harmless(&self, scenario: &Scenario, bracket: &Bracket) -> bool {
        L::is_harmless(scenario, bracket)
    }

    fn check_reaction(&self, scenario: &Scenario) -> Result<(), FieldError> {
        L::check_reaction(scenario)
    }

    fn check_decoy(&self, scenario: &Scenario, bracket: &Bracket) -> Result<(), FieldError> {
        L::check_decoy(scenario, bracket)
    }

    fn distance(&self, a: &Value, b: &Value) -> f64 {
        match (L::from_json(a), L::from_json(b)) {
            (Ok(a), Ok(b)) => L::distance(&a, &b),
            _ => 1.0, // an invalid design is similar to none
        }
    }

    fn sample(&self, brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng) -> Option<Value> {
        L::sample(brief, base, rng).map(|design| L::to_json(&design))
    }

    fn edit(
        &self,
        design: &Value,
        brief: &DesignBrief,
        base: &Scenario,
        direction: Option<EditDirection>,
        rng: &mut KeyedRng,
    ) -> Option<Value> {
        let design = parse_for::<L>(design, brief).ok()?;
        L::edit(&design, brief, base, direction, rng).map(|design| L::to_json(&design))
    }

    fn aim_place(&self, design: &Value) -> Option<String> {
        L::aim_place(design)
    }

    fn table(&self, design: &Value) -> Option<DesignTable> {
        L::from_json(design).ok().map(|design| L::table(&design))
    }

    fn draw(&self, layout: LayoutView<'_>) -> String {
        L::draw(layout)
    }
}
