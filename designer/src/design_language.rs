//! [`DesignLanguage`]: the interface that a world implements so that layouts can be designed for it.

use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;

use crate::brief::{DesignBrief, ParamChoice};
use crate::edit_direction::EditDirection;
use crate::field_error::FieldError;
use crate::refusal::{Refusal, RefusalWords};

/// Kind of a layout, as its design claims and the gate verifies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayoutKind {
    /// Layout in which holding fails.
    Threat,
    /// Holding succeeds, and every action is a waste.
    Decoy,
}

impl LayoutKind {
    /// Returns the name of the kind in the API and the store.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Threat => "threat",
            Self::Decoy => "decoy",
        }
    }
}

/// Language of one world's layouts.
///
/// A design is a JSON object with at least `name` and `aim.mode`; its other fields belong to the world. A design is built in
/// a *base scenario*: task, params and seed without a layout, whose seed decides the bodies that the design leaves open.
pub trait DesignLanguage: Sync {
    /// Returns the texts of the world's prompts.
    fn prompt_texts(&self) -> &'static PromptTexts;

    /// Returns the words of the world in refusals.
    fn refusal_words(&self) -> &'static RefusalWords;

    /// Returns the params that a design may choose: those of the brief that have an effect on a layout.
    fn param_choices<'a>(&self, brief: &'a DesignBrief) -> Vec<&'a ParamChoice>;

    /// Returns the rules of the world and of the language, as text for a prompt.
    fn rules(&self, brief: &DesignBrief) -> String;

    /// Returns the JSON schema of one design, with its aim first. All numbers are integers, since grammars do not enforce the
    /// range of fractions.
    fn schema(&self, brief: &DesignBrief) -> Value;

    /// Returns true if a value is a design of this language, valid or not. Text of a model has other values beside designs, and
    /// the provenance of a layout may be anything.
    fn is_design(&self, value: &Value) -> bool;

    /// Parses a design and returns its canonical form.
    ///
    /// # Errors
    /// Returns the first invalid field, and which values are allowed.
    fn parse(&self, design: &Value, brief: &DesignBrief) -> Result<Value, FieldError>;

    /// Builds a parsed design in a base scenario. Returns the scenario and the kind of the layout.
    ///
    /// # Errors
    /// Returns [`Refusal::Schema`] if the design cannot be parsed, [`Refusal::Compiles`] if a body cannot be placed, and
    /// [`Refusal::Aim`] if the design does not match its aim.
    fn build(&self, design: &Value, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal>;

    /// Returns true if a layout of threats threatens no agent that acts blindly. The layout is contested.
    fn is_harmless(&self, scenario: &Scenario, bracket: &Bracket) -> bool;

    /// Checks that an agent can still act once its observations show a threat. The planner knows everything from the start, so
    /// that it also avoids what an agent cannot see in time.
    ///
    /// # Errors
    /// Returns the part of the layout that comes too early or unseen.
    fn check_reaction(&self, scenario: &Scenario) -> Result<(), FieldError>;

    /// Checks that holding succeeds in a layout of decoys, and that a naive agent wastes fuel in it. A world without decoys
    /// refuses them all.
    ///
    /// # Errors
    /// Returns the condition that is not met.
    fn check_decoy(&self, scenario: &Scenario, bracket: &Bracket) -> Result<(), FieldError>;

    /// Returns the distance of two designs: 0 for equal ones, 1 for unrelated ones.
    fn distance(&self, a: &Value, b: &Value) -> f64;

    /// Samples a design from the failure profile of the brief; `None` if nothing fits the base scenario.
    fn sample(&self, brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng) -> Option<Value>;

    /// Applies a few random edits to a design; `None` if no edit fits the base scenario. With a direction, the edits make the
    /// layout easier or harder, or change parts that do not decide its difficulty.
    fn edit(
        &self,
        design: &Value,
        brief: &DesignBrief,
        base: &Scenario,
        direction: Option<EditDirection>,
        rng: &mut KeyedRng,
    ) -> Option<Value>;

    /// Returns the place of a design's aim as part of a prompt, such as `from 90 degrees`; `None` if it has none. The design may
    /// be invalid, and its text is untrusted.
    fn aim_place(&self, design: &Value) -> Option<String>;

    /// Returns a design as a table; `None` if it cannot be parsed.
    fn table(&self, design: &Value) -> Option<DesignTable>;

    /// Draws a layout as an SVG document.
    fn draw(&self, layout: LayoutView<'_>) -> String;
}

/// Texts of the prompts of one world. A change of any of them needs a new version.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PromptTexts {
    /// World and version, such as `kessler-3`, by which a layout is traceable to its prompt.
    pub version: &'static str,
    /// Template of the system message. `{{rules}}` stands for the rules of the language.
    pub system: &'static str,
    /// Advice for an agent whose failures are unknown.
    pub unknown_failures: &'static str,
    /// Titles of the columns of the failure profile after *share* and *mode*: sector, band of speed, steps left to act.
    pub profile_columns: &'static str,
}

/// Design as a table for display.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DesignTable {
    /// Short description of the design's aim.
    pub aim: String,
    /// Column titles of the parts of the design, with units.
    pub header: Vec<&'static str>,
    /// Parts of the design (encounters, deputies, target fields, or the start if there is no field), one row each, in order.
    pub rows: Vec<Vec<String>>,
}

/// Layout that is to be drawn.
#[derive(Debug, Clone, Copy)]
pub struct LayoutView<'a> {
    /// Name of the layout, for display.
    pub name: &'a str,
    /// Design of the layout; `None` if it was made by hand.
    pub design: Option<&'a Value>,
    /// Scenario of the layout.
    pub scenario: &'a Scenario,
    /// Bracket of the scenario, with the reference plan.
    pub bracket: &'a Bracket,
}
