//! Where designers come from: the service is given them, and knows no endpoint or key.

use designer::Designer;
use designer::llm::Llm;
use designer::procedural::Procedural;
use serde_json::Value;

/// A kind of designer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Which {
    /// A language model.
    Llm,
    /// The one that samples and edits.
    Procedural,
}

impl Which {
    /// The word on the wire and in the store.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Llm => "llm",
            Self::Procedural => "procedural",
        }
    }

    /// The kind with this word.
    #[must_use]
    pub fn of(word: &str) -> Option<Self> {
        [Self::Llm, Self::Procedural].into_iter().find(|which| which.word() == word)
    }
}

/// Makes designers.
pub trait Designers: std::fmt::Debug + Send + Sync {
    /// A designer for a run; none where there is none of the kind.
    fn designer(&self, which: Which, run: &str) -> Option<Box<dyn Designer>>;

    /// Whether a language model is configured.
    fn has_llm(&self) -> bool;

    /// How the language model is, for people; none where none is configured. It holds no keys.
    fn health(&self) -> Option<Value> {
        None
    }

    /// Counts what asking the language model took on a day (days since 1970 UTC) before this process began: budgets survive
    /// restarts.
    fn restore(&self, _run: &str, _tokens: u64, _cost: f64, _day: i64) {}
}

/// Those that need no configuration.
#[derive(Debug, Clone, Copy, Default)]
pub struct BuiltIn;

impl Designers for BuiltIn {
    fn designer(&self, which: Which, _: &str) -> Option<Box<dyn Designer>> {
        match which {
            Which::Llm => None,
            Which::Procedural => Some(Box::new(Procedural)),
        }
    }

    fn has_llm(&self) -> bool {
        false
    }
}

/// Those, and a language model.
#[derive(Debug, Clone)]
pub struct WithModel(pub Llm);

impl Designers for WithModel {
    fn designer(&self, which: Which, run: &str) -> Option<Box<dyn Designer>> {
        match which {
            Which::Llm => Some(Box::new(self.0.designer(run))),
            Which::Procedural => BuiltIn.designer(which, run),
        }
    }

    fn has_llm(&self) -> bool {
        true
    }

    fn health(&self) -> Option<Value> {
        serde_json::to_value(self.0.health()).ok()
    }

    fn restore(&self, run: &str, tokens: u64, cost: f64, day: i64) {
        self.0.restore(run, tokens, cost, day);
    }
}
