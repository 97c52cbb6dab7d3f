//! Of some scenarios that are drawn, the one whose predicted success is nearest one half.

use env_core::bracket;

use super::Prepared;

/// A choice under way.
pub(super) struct Choice {
    /// How many are still to come.
    left: u32,
    base: f64,
    panel: f64,
    /// The best so far, and how far from one half it is.
    best: Option<(f64, Prepared)>,
}

impl Choice {
    /// Among so many, where `base` is the logit of success without a blind plan that succeeds and `panel` is added where all do.
    pub(super) const fn new(among: u32, base: f64, panel: f64) -> Self {
        Self { left: among, base, panel, best: None }
    }

    /// Takes one more; whether it was the last.
    pub(super) fn take(&mut self, prepared: Prepared) -> bool {
        let share = bracket::panel_share(&prepared.scenario, &prepared.bracket);
        let success = 1.0 / (1.0 + libm::exp(-(self.base + self.panel * share)));
        let off = (success - 0.5).abs();
        if self.best.as_ref().is_none_or(|(least, _)| off < *least) {
            self.best = Some((off, prepared));
        }
        self.left = self.left.saturating_sub(1);
        self.left == 0
    }

    /// The best of those that were taken.
    pub(super) fn best(self) -> Option<Prepared> {
        self.best.map(|(_, prepared)| prepared)
    }
}
