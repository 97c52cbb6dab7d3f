//! Of some scenarios that are drawn, the one whose predicted success is nearest one half.
use env_core::admission;

use crate::leases::prepare::PreparedScenario;

/// A choice under way.
pub(crate) struct Choice {
    /// How many are still to come.
    left: u32,
    base: f64,
    panel: f64,
    /// The best so far, and how far from one half it is.
    best: Option<(f64, PreparedScenario)>,
}

impl Choice {
    /// Among so many, where `base` is the logit of success without a blind plan that succeeds and `panel` is added where all do.
    pub(crate) const fn new(among: u32, base: f64, panel: f64) -> Self {
        Self { left: among, base, panel, best: None }
    }

    /// Takes one more; whether it was the last.
    pub(crate) fn take(&mut self, prepared: PreparedScenario) -> bool {
        let share = admission::panel_success_rate(&prepared.scenario, &prepared.bracket);
        let success = 1.0 / (1.0 + libm::exp(-(self.base + self.panel * share)));
        let off = (success - 0.5).abs();
        if self.best.as_ref().is_none_or(|(least, _)| off < *least) {
            self.best = Some((off, prepared));
        }
        self.left = self.left.saturating_sub(1);
        self.left == 0
    }

    /// The best of those that were taken.
    pub(crate) fn best(self) -> Option<PreparedScenario> {
        self.best.map(|(_, prepared)| prepared)
    }
}
