//! Scenario design: designers behind one trait, and the gate that every layout passes before an agent sees it.
//!
//! So far there is one designer, [`replay`], which reads layouts from a file. Designers that study an agent's failures
//! (procedural, and a language model) come behind the same trait.

pub mod gate;
pub mod kessler;
pub mod replay;

use std::future::Future;
use std::pin::Pin;

use env_core::Scenario;

/// What a designer is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Brief {
    /// The task to design for; none for any.
    pub task: Option<String>,
    /// How many layouts are wanted at most.
    pub count: usize,
}

/// A layout as a designer gives it: not yet gated.
#[derive(Debug, Clone, PartialEq)]
pub struct Draft {
    /// Its name, for people.
    pub name: String,
    /// The scenario it makes.
    pub scenario: Scenario,
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
    #[error("layout {number} ({name:?}): {source}")]
    Layout {
        /// Its place, counted from 1.
        number: usize,
        /// Its name.
        name: String,
        /// What is wrong with it.
        source: env_core::ScenarioError,
    },
}

/// What a designer's work comes to, in time.
pub type Designing<'a> = Pin<Box<dyn Future<Output = Result<Vec<Draft>, DesignError>> + Send + 'a>>;

/// Something that thinks of layouts. It may take long (a language model does): never in a trainer's path.
pub trait Designer: Send {
    /// Its name, as provenance says it.
    fn name(&self) -> &'static str;

    /// Layouts for a brief.
    fn design<'a>(&'a mut self, brief: &'a Brief) -> Designing<'a>;
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

/// At most 60 characters of what a stranger wrote, for a message.
fn shorten(text: &str) -> String {
    if text.chars().count() <= 60 {
        text.to_owned()
    } else {
        text.chars().take(57).chain("...".chars()).collect()
    }
}
