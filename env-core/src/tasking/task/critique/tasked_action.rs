//! Kinds of actions that are common to the tasks.

/// Number of actions that are the same in all tasks: charge, downlink and desaturate, after those that scan or image.
const OTHERS: usize = 3;

/// Kind of an action.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TaskedAction {
    /// Scans, or images a target.
    Work,
    /// Charges the battery with the panel.
    Charge,
    /// Sends data to a ground station.
    Downlink,
    /// Desaturates the wheels with thrusters.
    Desaturate,
}

impl TaskedAction {
    /// Kind of the action of an index among `count`.
    pub(super) const fn of(index: usize, count: usize) -> Self {
        match index.checked_sub(count.saturating_sub(OTHERS)) {
            None => Self::Work,
            Some(0) => Self::Charge,
            Some(1) => Self::Downlink,
            Some(_) => Self::Desaturate,
        }
    }

    /// Index of the action among `count`; of those that scan or image, the first.
    pub(super) const fn index(self, count: usize) -> usize {
        let first = count.saturating_sub(OTHERS);
        match self {
            Self::Work => 0,
            Self::Charge => first,
            Self::Downlink => first + 1,
            Self::Desaturate => first + 2,
        }
    }
}
