//! Status of layouts: when one retires and when it is put back, decided from its last outcomes alone.

use store::layout_transitions::LayoutTransition;
use store::layouts::{LayoutState, RetirementReason};

/// Number of outcomes in the window.
pub const OUTCOME_WINDOW: usize = 16;
/// Number of outcomes from which a layout can be mastered.
pub const MIN_MASTERED_OUTCOMES: usize = 8;
/// Mean of the window from which a layout is mastered.
pub const MASTERED_MEAN: f64 = 0.9;
/// Number of consecutive outcomes without success after which a layout is hopeless.
pub const HOPELESS_STREAK: u32 = 24;
/// Outcome of a mastered layout below which the agent has forgotten it.
pub const FORGOTTEN_BELOW: f64 = 0.5;

/// Status of a layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayoutStatus {
    /// The layout is served.
    Active,
    /// The agent has mastered it; it is probed now and then, in case the agent forgets it.
    Mastered,
    /// The agent never succeeds on it; it is probed now and then, in case the agent learns it.
    Hopeless,
    /// A user retired it; it is never served.
    RetiredByUser,
}

impl LayoutStatus {
    /// Returns the status of a stored layout; `None` if the gate refused it.
    #[must_use]
    pub const fn from_stored(
        state: LayoutState,
        retirement_reason: Option<RetirementReason>,
    ) -> Option<Self> {
        match (state, retirement_reason) {
            (LayoutState::Refused, _) => None,
            (LayoutState::Active, _) => Some(Self::Active),
            (LayoutState::Retired, Some(RetirementReason::Mastered)) => Some(Self::Mastered),
            (LayoutState::Retired, Some(RetirementReason::Hopeless)) => Some(Self::Hopeless),
            (LayoutState::Retired, Some(RetirementReason::User) | None) => Some(Self::RetiredByUser),
        }
    }

    /// Returns the stored transition to this status.
    #[must_use]
    pub const fn transition(self, reason: String) -> LayoutTransition {
        let (state, retirement_reason) = match self {
            Self::Active => (LayoutState::Active, None),
            Self::Mastered => (LayoutState::Retired, Some(RetirementReason::Mastered)),
            Self::Hopeless => (LayoutState::Retired, Some(RetirementReason::Hopeless)),
            Self::RetiredByUser => (LayoutState::Retired, Some(RetirementReason::User)),
        };
        LayoutTransition { state, retirement_reason, reason }
    }
}

/// Status and last outcomes of a layout.
#[derive(Debug, Clone, PartialEq)]
pub struct LayoutHistory {
    /// Status of the layout.
    pub status: LayoutStatus,
    /// Its last outcomes, oldest first: success rates of groups, 0 to 1.
    pub recent: Vec<f64>,
    /// Number of consecutive outcomes without success.
    pub zero_success_streak: u32,
}

impl LayoutHistory {
    /// Returns the history of a new layout.
    #[must_use]
    pub const fn new() -> Self {
        Self { status: LayoutStatus::Active, recent: Vec::new(), zero_success_streak: 0 }
    }

    /// Adds an outcome, the success rate of a group. Returns the reason if the status changes.
    pub fn observe(&mut self, value: f64) -> Option<String> {
        let value = if value.is_finite() { value.clamp(0.0, 1.0) } else { 0.0 };
        let (status, reason) = match self.status {
            LayoutStatus::Mastered if value < FORGOTTEN_BELOW => {
                let reason = format!("reactivated: success fell to {value:.2} after mastery");
                *self = Self::new();
                (LayoutStatus::Active, Some(reason))
            }
            LayoutStatus::Hopeless if value > 0.0 => {
                let reason = format!("reactivated: success rose to {value:.2} after no success");
                *self = Self::new();
                (LayoutStatus::Active, Some(reason))
            }
            status => (status, None),
        };
        self.push(value);
        if reason.is_some() {
            return reason;
        }
        if status != LayoutStatus::Active {
            return None;
        }
        let (status, reason) = self.retirement()?;
        self.status = status;
        Some(reason)
    }

    /// Adds an outcome to the window.
    fn push(&mut self, value: f64) {
        if self.recent.len() >= OUTCOME_WINDOW {
            self.recent.drain(..=self.recent.len() - OUTCOME_WINDOW);
        }
        self.recent.push(value);
        self.zero_success_streak = if value > 0.0 { 0 } else { self.zero_success_streak.saturating_add(1) };
    }

    /// Returns the new status of an active layout that retires, and the reason.
    fn retirement(&self) -> Option<(LayoutStatus, String)> {
        let n = self.recent.len();
        let mean = self.recent.iter().sum::<f64>() / n.max(1) as f64;
        if n >= MIN_MASTERED_OUTCOMES && mean >= MASTERED_MEAN {
            let reason = format!("mastered: {mean:.2} of its last {n} groups succeeded");
            return Some((LayoutStatus::Mastered, reason));
        }
        (self.zero_success_streak >= HOPELESS_STREAK).then(|| {
            (
                LayoutStatus::Hopeless,
                format!("hopeless: none of its last {} groups", self.zero_success_streak),
            )
        })
    }
}

impl Default for LayoutHistory {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn history_of(values: &[f64]) -> LayoutHistory {
        let mut history = LayoutHistory::new();
        for &value in values {
            history.observe(value);
        }
        history
    }

    #[test]
    fn layout_retires_once_mastered_or_hopeless() {
        assert_eq!(history_of(&[1.0; 7]).status, LayoutStatus::Active);
        assert_eq!(history_of(&[1.0; 8]).status, LayoutStatus::Mastered);
        assert_eq!(history_of(&[0.875; 40]).status, LayoutStatus::Active);
        assert_eq!(history_of(&[0.0; 23]).status, LayoutStatus::Active);
        assert_eq!(history_of(&[0.0; 24]).status, LayoutStatus::Hopeless);
        let mut one_success = vec![0.0; 23];
        one_success.push(0.25);
        one_success.extend([0.0; 23]);
        assert_eq!(history_of(&one_success).status, LayoutStatus::Active);
    }

    #[test]
    fn contradicting_probe_reactivates_with_empty_window() {
        let mut mastered = history_of(&[1.0; 12]);
        assert_eq!(mastered.observe(0.5), None);
        assert_eq!(mastered.status, LayoutStatus::Mastered);
        assert!(mastered.observe(0.25).unwrap().contains("fell to"));
        assert_eq!((mastered.status, mastered.recent.as_slice()), (LayoutStatus::Active, &[0.25][..]));

        let mut hopeless = history_of(&[0.0; 30]);
        assert_eq!(hopeless.observe(0.0), None);
        assert!(hopeless.observe(0.125).unwrap().contains("rose to"));
        assert_eq!((hopeless.status, hopeless.zero_success_streak), (LayoutStatus::Active, 0));
    }

    #[test]
    fn manually_retired_layout_stays_retired() {
        let mut history = LayoutHistory { status: LayoutStatus::RetiredByUser, ..history_of(&[0.5; 4]) };
        for value in [0.0, 1.0].into_iter().cycle().take(200) {
            assert_eq!(history.observe(value), None);
        }
        assert_eq!(history.status, LayoutStatus::RetiredByUser);
    }

    #[test]
    fn stored_status_reads_back() {
        for status in [
            LayoutStatus::Active,
            LayoutStatus::Mastered,
            LayoutStatus::Hopeless,
            LayoutStatus::RetiredByUser,
        ] {
            let stored = status.transition(String::new());
            assert_eq!(LayoutStatus::from_stored(stored.state, stored.retirement_reason), Some(status));
        }
        assert_eq!(LayoutStatus::from_stored(LayoutState::Refused, None), None);
    }

    proptest! {
        /// The window has the last values since the layout started or was put back, at most 16. It is retired only on
        /// evidence, and a reason is returned for each change of status.
        #[test]
        fn status_follows_outcomes(values in proptest::collection::vec((0u32..=4).prop_map(|n| f64::from(n) / 4.0), 0..120)) {
            let mut history = LayoutHistory::new();
            let mut since = 0;
            for (at, &value) in values.iter().enumerate() {
                let before = history.status;
                let reason = history.observe(value);
                prop_assert_eq!(reason.is_some(), history.status != before);
                if before != LayoutStatus::Active && history.status == LayoutStatus::Active {
                    since = at;
                }
                let window = &values[since.max((at + 1).saturating_sub(OUTCOME_WINDOW))..=at];
                prop_assert_eq!(history.recent.as_slice(), window);
                let barren = values[since..=at].iter().rev().take_while(|v| **v == 0.0).count();
                prop_assert_eq!(history.zero_success_streak as usize, barren);
                match (before, history.status) {
                    (LayoutStatus::Active, LayoutStatus::Mastered) => {
                        let mean = window.iter().sum::<f64>() / window.len() as f64;
                        prop_assert!(window.len() >= MIN_MASTERED_OUTCOMES && mean >= MASTERED_MEAN);
                    }
                    (LayoutStatus::Active, LayoutStatus::Hopeless) => prop_assert!(history.zero_success_streak >= HOPELESS_STREAK),
                    (LayoutStatus::Mastered, LayoutStatus::Active) => prop_assert!(value < FORGOTTEN_BELOW),
                    (LayoutStatus::Hopeless, LayoutStatus::Active) => prop_assert!(value > 0.0),
                    (before, after) => prop_assert_eq!(before, after),
                }
            }
        }

        /// A number that is no success rate counts as failure.
        #[test]
        fn any_number_is_accepted(bits in proptest::collection::vec(any::<u64>(), 0..60)) {
            let mut history = LayoutHistory::new();
            for bits in bits {
                history.observe(f64::from_bits(bits));
                prop_assert!(history.recent.iter().all(|v| (0.0..=1.0).contains(v)));
            }
        }
    }
}
