//! The [`Designer`] trait, its result and its errors.

use std::future::Future;
use std::pin::Pin;
use std::time::Duration;

use serde_json::Value;

use crate::brief::DesignBrief;
use crate::gate::{AdmittedLayout, Gate};
use crate::refusal::Refusal;

/// Source of layouts. It may be slow (a language model takes minutes), so the server keeps it away from requests of trainers.
pub trait Designer: Send {
    /// Returns the name of the designer, which is stored with its layouts.
    fn name(&self) -> &'static str;

    /// Makes layouts for a brief and passes each through the gate.
    fn design<'a>(&'a mut self, brief: &'a DesignBrief, gate: &'a mut Gate) -> DesignFuture<'a>;
}

/// Future that [`Designer::design`] returns.
pub type DesignFuture<'a> = Pin<Box<dyn Future<Output = Result<DesignOutcome, DesignError>> + Send + 'a>>;

/// Result of a designer.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DesignOutcome {
    /// Every layout that the designer made, in order, also those that the gate refused.
    pub judged: Vec<JudgedLayout>,
    /// Effort of the designer.
    pub usage: DesignUsage,
    /// Problems that did not end the work, one sentence each.
    pub warnings: Vec<String>,
}

impl DesignOutcome {
    /// Returns the number of admitted layouts.
    #[must_use]
    pub fn admitted(&self) -> usize {
        self.judged.iter().filter(|judged| judged.verdict.is_ok()).count()
    }
}

/// Layout with the gate's verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct JudgedLayout {
    /// Name of the layout, for display.
    pub name: String,
    /// Design as the designer gave it; `None` for a scenario without a design.
    pub design: Option<Value>,
    /// Number of the attempt, from which the base scenarios follow in which the gate judged the layout.
    pub attempt: u64,
    /// Round in which the designer gave it: 1, and one more for each repair.
    pub round: u32,
    /// Verdict of the gate.
    pub verdict: Result<AdmittedLayout, Refusal>,
}

/// Effort of a designer.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DesignUsage {
    /// Name of the language model; `None` if none was asked.
    pub model: Option<String>,
    /// Version of the prompt; `None` if no model was asked.
    pub prompt: Option<String>,
    /// Number of rounds, repairs included.
    pub rounds: u32,
    /// Number of prompt tokens.
    pub tokens_in: u64,
    /// Number of completion tokens.
    pub tokens_out: u64,
    /// Cost of the tokens, in the currency of the configured prices.
    pub cost: f64,
    /// Time from the start to the last verdict; 0 for designers other than a language model.
    pub latency: Duration,
}

/// Reason why a designer returned no layouts.
#[derive(Debug, thiserror::Error)]
pub enum DesignError {
    /// The file of layouts cannot be used.
    #[error("{file}: {reason}")]
    File {
        /// Path of the file.
        file: String,
        /// Problem of the file.
        reason: String,
    },
    /// An entry of the file is not a valid scenario.
    #[error("layout {number} ({name:?}): {error}")]
    Layout {
        /// Position in the file, counted from 1.
        number: usize,
        /// Name of the layout.
        name: String,
        /// Problem of its scenario.
        error: env_core::ScenarioError,
    },
    /// The language model returned no layouts.
    #[error(transparent)]
    Model(#[from] llm::LlmError),
}
