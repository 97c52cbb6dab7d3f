//! Actions that do not depend on what a satellite observes.

use self::BlindAction::{Charge, Work};

/// Cycle of the policy `blind`.
pub(super) const BLIND_CYCLE: &[BlindAction] = &[Work(0), Work(0), Charge];

/// Gives actions in a fixed order to each satellite.
pub(super) struct CyclePolicy {
    cycle: &'static [BlindAction],
    given: Vec<usize>,
}

/// An action that does not depend on what a satellite observes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BlindAction {
    /// Scans, or images the target at this index.
    Work(usize),
    /// Charges the battery with the panel.
    Charge,
    /// Sends data to a ground station.
    Downlink,
    /// Desaturates the wheels with thrusters.
    Desaturate,
}

impl BlindAction {
    /// Index of the action among `count`, of which the last three are charge, downlink and desaturate.
    pub(super) fn index(self, count: usize) -> usize {
        let others = count.saturating_sub(3);
        match self {
            Self::Work(index) => index.min(others.saturating_sub(1)),
            Self::Charge => others,
            Self::Downlink => others + 1,
            Self::Desaturate => others + 2,
        }
    }
}

impl CyclePolicy {
    pub(super) const fn new(cycle: &'static [BlindAction]) -> Self {
        Self { cycle, given: Vec::new() }
    }

    /// The next action of a satellite.
    pub(super) fn next(&mut self, satellite: usize, count: usize) -> usize {
        if self.given.len() <= satellite {
            self.given.resize(satellite + 1, 0);
        }
        let action = self.cycle[self.given[satellite] % self.cycle.len()];
        self.given[satellite] += 1;
        action.index(count)
    }
}
