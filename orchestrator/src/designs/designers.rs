//! Where designers come from: the service is given them, and knows no endpoint or key.

use designer::Designer;
use designer::llm_designer::LlmDesigner;
use llm::{LlmClient, Spending};
use designer::procedural::ProceduralDesigner;
use serde_json::Value;

use crate::store::design_requests::DesignerKind;

/// Makes designers.
pub trait Designers: std::fmt::Debug + Send + Sync {
    /// A designer for a run; none where there is none of the kind.
    fn designer(&self, which: DesignerKind, run: &str) -> Option<Box<dyn Designer>>;

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
pub struct BuiltInDesigners;

impl Designers for BuiltInDesigners {
    fn designer(&self, which: DesignerKind, _: &str) -> Option<Box<dyn Designer>> {
        match which {
            DesignerKind::Llm => None,
            DesignerKind::Procedural => Some(Box::new(ProceduralDesigner)),
        }
    }

    fn has_llm(&self) -> bool {
        false
    }
}

/// Those, and a language model.
#[derive(Debug, Clone)]
pub struct DesignersWithModel(pub LlmClient);

impl Designers for DesignersWithModel {
    fn designer(&self, which: DesignerKind, run: &str) -> Option<Box<dyn Designer>> {
        match which {
            DesignerKind::Llm => Some(Box::new(LlmDesigner::new(self.0.clone(), run))),
            DesignerKind::Procedural => BuiltInDesigners.designer(which, run),
        }
    }

    fn has_llm(&self) -> bool {
        true
    }

    fn health(&self) -> Option<Value> {
        serde_json::to_value(self.0.health()).ok()
    }

    fn restore(&self, run: &str, tokens: u64, cost: f64, day: i64) {
        self.0.restore_spending(run, Spending { tokens, cost }, day);
    }
}
