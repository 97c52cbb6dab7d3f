//! Scenario design: designers behind one trait, and the gate that every layout passes before an agent sees it.
//!
//! A [`Designer`] is given a [`Brief`] (what the agent fails at, within which limits) and the [`Gate`]; it answers with the
//! layouts it thought of and what the gate said of each. [`procedural`] samples from the failure profile and edits what
//! worked; [`llm`] asks a language model; [`replay`] reads layouts from a file. What designs are said in is the world's: [`language`], [`kessler`].

pub mod brief;
mod docking;
pub mod gate;
pub mod kessler;
pub mod language;
pub mod llm;
pub mod picture;
pub mod procedural;
pub mod profile;
pub mod replay;
pub mod vary;

use std::future::Future;
use std::pin::Pin;

pub use self::brief::Brief;
pub use self::gate::{Admitted, Gate, Judged, Refusal, Usage};
pub use self::language::{Claim, Language, Listing, language};
pub use self::profile::Profile;
pub use self::vary::{Varied, vary};

/// What a designer came up with.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Designed {
    /// Every layout it thought of, those refused included, in order.
    pub judged: Vec<Judged>,
    /// What it took.
    pub usage: Usage,
    /// What went wrong on the way without ending it, in a sentence each.
    pub troubles: Vec<String>,
}

impl Designed {
    /// How many the gate let through.
    #[must_use]
    pub fn admitted(&self) -> usize {
        self.judged.iter().filter(|judged| judged.verdict.is_ok()).count()
    }
}

/// A designer that could not design.
#[derive(Debug, thiserror::Error)]
pub enum DesignError {
    /// What it works from cannot be had.
    #[error("{what}: {reason}")]
    Source {
        /// What it works from.
        what: String,
        /// Why.
        reason: String,
    },
    /// A layout that is none.
    #[error("layout {number} ({name:?}): {fault}")]
    Layout {
        /// Its place, counted from 1.
        number: usize,
        /// Its name.
        name: String,
        /// What is wrong with it.
        fault: env_core::ScenarioError,
    },
    /// The language model gave nothing.
    #[error(transparent)]
    Model(#[from] llm::LlmError),
}

/// What a designer's work comes to, in time.
pub type Designing<'a> = Pin<Box<dyn Future<Output = Result<Designed, DesignError>> + Send + 'a>>;

/// Something that thinks of layouts. It may take long (a language model does): never in a trainer's path.
pub trait Designer: Send {
    /// Its name, as provenance says it.
    fn name(&self) -> &'static str;

    /// Layouts for a brief, each passed through the gate.
    fn design<'a>(&'a mut self, brief: &'a Brief, gate: &'a mut Gate) -> Designing<'a>;
}

/// What is wrong with a design, in a sentence that its designer can act on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {words}")]
pub struct Fault {
    /// The field at fault.
    pub field: String,
    /// What is wrong there, and what would do.
    pub words: String,
}

impl Fault {
    fn new(field: impl Into<String>, words: impl Into<String>) -> Self {
        Self { field: field.into(), words: words.into() }
    }
}

/// Whether a character moves the cursor or turns the direction of text instead of standing for something.
fn steers(c: char) -> bool {
    c.is_control() || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// At most 60 characters of what a stranger wrote, for a message, in one line and with nothing that steers a terminal.
fn shorten(text: &str) -> String {
    let text: String = text.chars().map(|c| if steers(c) { ' ' } else { c }).collect();
    if text.chars().count() <= 60 {
        text.to_owned()
    } else {
        text.chars().take(57).chain("...".chars()).collect()
    }
}
