//! What a world must know so that layouts can be designed for it: the language designs are said in, what makes bodies of
//! them, and whether they keep what they claim.

use env_core::bracket::Bracket;
use env_core::{Draws, Scenario, TaskSpec};
use serde_json::Value;

use crate::Fault;
use crate::brief::Brief;
use crate::gate::Refusal;
use crate::picture::Subject;

/// What a layout claims to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Claim {
    /// Who does nothing loses.
    Threat,
    /// Who does nothing succeeds, and acting is a waste.
    Decoy,
}

impl Claim {
    /// The word on the wire.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Threat => "threat",
            Self::Decoy => "decoy",
        }
    }
}

/// The language of one world's layouts. Designs are JSON objects with at least `name` and `aim.mode`; what else they say
/// is the world's.
pub trait Language: Sync {
    /// The rules of the world and of the language, for a prompt.
    fn rules(&self, brief: &Brief) -> String;
    /// The JSON schema of one design, its aim first. Whole numbers only: grammars do not hold fractions to their bounds.
    fn schema(&self, brief: &Brief) -> Value;
    /// Reads a design: its canonical form.
    ///
    /// # Errors
    /// The field at fault, and what is wanted there.
    fn read(&self, design: &Value, brief: &Brief) -> Result<Value, Fault>;
    /// Makes bodies of a design as [`Language::read`] gives it, under a sky; and what it claims, if its encounters are what
    /// its aim says.
    ///
    /// # Errors
    /// The encounter that cannot be, and what would do; or what of the aim is not kept.
    fn build(&self, design: &Value, sky: &Scenario) -> Result<(Scenario, Claim), Refusal>;
    /// That what hits who does nothing is seen early enough to be dodged, and hits nobody before anybody could act: the
    /// planner knows all, and finds ways that nobody could who sees what the agents see.
    ///
    /// # Errors
    /// Who is hit when, in a sentence.
    fn seen(&self, scenario: &Scenario) -> Result<(), Fault>;
    /// Whether a decoy is honest: who holds succeeds, and a naive agent wastes.
    ///
    /// # Errors
    /// What is not so.
    fn decoy(&self, scenario: &Scenario, bracket: &Bracket) -> Result<(), Fault>;
    /// How different two designs are: 0 the same, 1 nothing alike.
    fn distance(&self, a: &Value, b: &Value) -> f64;
    /// A new design for this sky that goes for what the agent fails at; none where nothing suits.
    fn sample(&self, brief: &Brief, sky: &Scenario, draws: &mut Draws) -> Option<Value>;
    /// A design with one thing changed at random, as it can be under this sky; none where nothing suits.
    fn edit(&self, design: &Value, brief: &Brief, sky: &Scenario, draws: &mut Draws) -> Option<Value>;
    /// A design for people: what it goes for, and its encounters as a table. None for what is no design.
    fn listing(&self, design: &Value) -> Option<Listing>;
    /// A layout drawn, as an SVG document ([`crate::picture::draw`]).
    fn picture(&self, subject: Subject<'_>) -> String;
}

/// A design for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listing {
    /// What it goes for, in a few words.
    pub aim: String,
    /// The columns of its encounters, with their units; what all but the last hold is a number.
    pub header: Vec<&'static str>,
    /// The encounters, in order.
    pub rows: Vec<Vec<String>>,
}

/// The language of a task's world; none for a world that nobody designs for yet.
#[must_use]
pub fn language(task: &dyn TaskSpec) -> Option<&'static dyn Language> {
    task.world().starts_with("kessler@").then_some(&crate::kessler::Kessler as &dyn Language)
}
