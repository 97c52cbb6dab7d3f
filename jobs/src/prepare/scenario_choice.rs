//! Chooses, among drawn scenarios, the one whose predicted success rate is nearest to one half.

use env_core::admission;

use crate::prepare::PreparedScenario;

/// A choice in progress.
pub(crate) struct ScenarioChoice {
    /// Number of scenarios that are still to be drawn.
    left: u32,
    /// Logit of the predicted success rate if no blind plan succeeds.
    base: f64,
    /// Added to the logit if all blind plans succeed, else in proportion.
    panel: f64,
    best: Option<Candidate>,
}

/// The best scenario so far.
struct Candidate {
    /// Distance of its predicted success rate from one half.
    distance: f64,
    prepared: PreparedScenario,
}

impl ScenarioChoice {
    /// Starts a choice among `among` scenarios. `base` is the logit of success if no blind plan succeeds; `panel` is added if all do.
    pub(crate) const fn new(among: u32, base: f64, panel: f64) -> Self {
        Self { left: among, base, panel, best: None }
    }

    /// Adds a scenario. Returns true if it was the last.
    pub(crate) fn add(&mut self, prepared: PreparedScenario) -> bool {
        let share = admission::panel_success_rate(&prepared.scenario, &prepared.bracket);
        let success = 1.0 / (1.0 + libm::exp(-(self.base + self.panel * share)));
        let distance = (success - 0.5).abs();
        if self.best.as_ref().is_none_or(|best| distance < best.distance) {
            self.best = Some(Candidate { distance, prepared });
        }
        self.left = self.left.saturating_sub(1);
        self.left == 0
    }

    /// Returns the best scenario that was added.
    pub(crate) fn best(self) -> Option<PreparedScenario> {
        self.best.map(|best| best.prepared)
    }
}
