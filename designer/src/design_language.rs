//! [`DesignLanguage`]: the interface that a world implements so that layouts can be designed for it.

use env_core::bracket::Bracket;
use env_core::{KeyedRng, Scenario};
use serde_json::Value;

use crate::brief::DesignBrief;
use crate::field_error::FieldError;
use crate::refusal::Refusal;

/// Kind of a layout, as its encounters claim and the gate verifies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayoutKind {
    /// Holding loses a satellite.
    Threat,
    /// Holding succeeds, and every burn is a waste.
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
    /// Returns the rules of the world and of the language, as text for a prompt.
    fn rules(&self, brief: &DesignBrief) -> String;

    /// Returns the JSON schema of one design, with its aim first. All numbers are integers, since grammars do not enforce the
    /// range of fractions.
    fn schema(&self, brief: &DesignBrief) -> Value;

    /// Parses a design and returns its canonical form.
    ///
    /// # Errors
    /// Returns the first invalid field, and which values are allowed.
    fn parse(&self, design: &Value, brief: &DesignBrief) -> Result<Value, FieldError>;

    /// Builds a parsed design in a base scenario. Returns the scenario and the kind of the layout.
    ///
    /// # Errors
    /// Returns [`Refusal::Schema`] if the design cannot be parsed, [`Refusal::Compiles`] if an encounter is impossible, and
    /// [`Refusal::Aim`] if the encounters do not match the aim.
    fn build(&self, design: &Value, base: &Scenario) -> Result<(Scenario, LayoutKind), Refusal>;

    /// Checks that debris that hits a holding satellite is visible early enough to be avoided, and that it hits no satellite
    /// before an agent can act. The planner knows all bodies, so it also avoids what agents cannot see.
    ///
    /// # Errors
    /// Returns the satellite that is hit and the step.
    fn check_visibility(&self, scenario: &Scenario) -> Result<(), FieldError>;

    /// Checks that holding succeeds in a layout of decoys, and that a naive agent wastes fuel in it.
    ///
    /// # Errors
    /// Returns the condition that is not met.
    fn check_decoy(&self, scenario: &Scenario, bracket: &Bracket) -> Result<(), FieldError>;

    /// Returns the distance of two designs: 0 for equal ones, 1 for unrelated ones.
    fn distance(&self, a: &Value, b: &Value) -> f64;

    /// Samples a design from the failure profile of the brief; `None` if nothing fits the base scenario.
    fn sample(&self, brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng) -> Option<Value>;

    /// Applies a few random edits to a design; `None` if no edit fits the base scenario.
    fn edit(&self, design: &Value, brief: &DesignBrief, base: &Scenario, rng: &mut KeyedRng)
    -> Option<Value>;

    /// Returns a design as a table; `None` if it cannot be parsed.
    fn table(&self, design: &Value) -> Option<DesignTable>;

    /// Draws a layout as an SVG document.
    fn draw(&self, layout: LayoutView<'_>) -> String;
}

/// Design as a table for display.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DesignTable {
    /// Short description of the design's aim.
    pub aim: String,
    /// Column titles of the encounters, with units. All columns but the last hold numbers.
    pub header: Vec<&'static str>,
    /// Encounters, one row each, in order.
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
