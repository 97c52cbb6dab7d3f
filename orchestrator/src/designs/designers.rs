//! Source of designers. The service is configured with one, and knows neither endpoint nor key.

use designer::Designer;
use designer::llm_designer::LlmDesigner;
use designer::procedural::ProceduralDesigner;
use llm::{LlmClient, Spending};
use serde_json::Value;

use store::design_requests::DesignerKind;

/// Creates designers for runs.
pub trait Designers: std::fmt::Debug + Send + Sync {
    /// Returns a designer for a run; `None` if there is none of the kind.
    fn designer(&self, kind: DesignerKind, run: &str) -> Option<Box<dyn Designer>>;

    /// Returns true if a language model is configured.
    fn has_llm(&self) -> bool;

    /// Returns the health of the language model as JSON without keys; `None` if no model is configured.
    fn health(&self) -> Option<Value> {
        None
    }

    /// Restores the tokens and the cost that a run spent on a day (days since 1970 UTC) before this process started: budgets
    /// survive restarts.
    fn restore(&self, _run: &str, _tokens: u64, _cost: f64, _day: i64) {}
}

/// The designers that need no configuration.
#[derive(Debug, Clone, Copy, Default)]
pub struct BuiltInDesigners;

impl Designers for BuiltInDesigners {
    fn designer(&self, kind: DesignerKind, _: &str) -> Option<Box<dyn Designer>> {
        match kind {
            DesignerKind::Llm => None,
            DesignerKind::Procedural => Some(Box::new(ProceduralDesigner)),
        }
    }

    fn has_llm(&self) -> bool {
        false
    }
}

/// The built-in designers and a language model.
#[derive(Debug, Clone)]
pub struct DesignersWithModel(pub LlmClient);

impl Designers for DesignersWithModel {
    fn designer(&self, kind: DesignerKind, run: &str) -> Option<Box<dyn Designer>> {
        match kind {
            DesignerKind::Llm => Some(Box::new(LlmDesigner::new(self.0.clone(), run))),
            DesignerKind::Procedural => BuiltInDesigners.designer(kind, run),
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
