//! Status of layouts: when one retires and when it is put back, decided from its last outcomes alone.

use curriculum::Posterior;
use store::layout_transitions::LayoutTransition;
use store::layouts::{LayoutState, RetirementReason};

/// Number of outcomes in the window.
pub const OUTCOME_WINDOW: usize = 16;
/// Number of outcomes before which an active layout is served whatever they are.
pub const TRIAL_OUTCOMES: usize = 2;
/// Success rate from which a layout is served.
pub const SERVED_FROM: f64 = 0.2;
/// Success rate from which a layout is mastered.
pub const MASTERED_FROM: f64 = 0.8;
/// Success rate that a hopeless layout almost surely does not have.
pub const HOPELESS_SUCCESS: f64 = 0.1;
/// Probability with which it does not.
const HOPELESS_CONFIDENCE: f64 = 0.95;
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
    /// Number of episodes of a group.
    pub group_size: u32,
}

impl LayoutHistory {
    /// Returns the history of a new layout.
    #[must_use]
    pub const fn new(group_size: u32) -> Self {
        Self { status: LayoutStatus::Active, recent: Vec::new(), zero_success_streak: 0, group_size }
    }

    /// Posterior over the success rate of the agent on the layout. Its episodes are independent, since they share the scenario.
    #[must_use]
    pub fn success(&self) -> Posterior {
        let n = u32::try_from(self.recent.len()).unwrap_or(u32::MAX).saturating_mul(self.group_size);
        Posterior { n, sum: self.recent.iter().sum::<f64>() * f64::from(self.group_size) }
    }

    /// Returns true if the layout is worth training on: it is active, and the agent succeeds on it sometimes, or it was hardly tried.
    #[must_use]
    pub fn is_served(&self) -> bool {
        let is_new = self.recent.len() < TRIAL_OUTCOMES;
        self.status == LayoutStatus::Active && (is_new || self.success().mean() >= SERVED_FROM)
    }

    /// Adds an outcome, the success rate of a group. Returns the reason if the status changes.
    pub fn observe(&mut self, value: f64) -> Option<String> {
        let value = if value.is_finite() { value.clamp(0.0, 1.0) } else { 0.0 };
        let (status, reason) = match self.status {
            LayoutStatus::Mastered if value < FORGOTTEN_BELOW => {
                let reason = format!("reactivated: success fell to {value:.2} after mastery");
                *self = Self::new(self.group_size);
                (LayoutStatus::Active, Some(reason))
            }
            LayoutStatus::Hopeless if value > 0.0 => {
                let reason = format!("reactivated: success rose to {value:.2} after no success");
                *self = Self::new(self.group_size);
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
        let (success, groups) = (self.success(), self.recent.len());
        let mean = success.mean();
        if groups >= TRIAL_OUTCOMES && mean >= MASTERED_FROM {
            let reason = format!("mastered: its success rate is {mean:.2} by its last {groups} groups");
            return Some((LayoutStatus::Mastered, reason));
        }
        let highest = success.quantile(HOPELESS_CONFIDENCE);
        (highest < HOPELESS_SUCCESS).then(|| {
            let reason = format!(
                "hopeless: its success rate is below {HOPELESS_SUCCESS} with a probability of {HOPELESS_CONFIDENCE}, by its \
                 last {groups} groups"
            );
            (LayoutStatus::Hopeless, reason)
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// History of a layout after outcomes of groups of two.
    fn history_of(values: &[f64]) -> LayoutHistory {
        let mut history = LayoutHistory::new(2);
        for &value in values {
            history.observe(value);
        }
        history
    }

    #[test]
    fn layout_retires_once_mastered_or_hopeless() {
        assert_eq!(history_of(&[1.0; 1]).status, LayoutStatus::Active);
        // Four of four: Beta(5, 1), whose mean is 5/6.
        assert_eq!(history_of(&[1.0; 2]).status, LayoutStatus::Mastered);
        // Seven of eight: Beta(8, 2), whose mean is 0.8.
        assert_eq!(history_of(&[1.0, 0.5, 1.0, 1.0]).status, LayoutStatus::Mastered);
        assert_eq!(history_of(&[0.5; 40]).status, LayoutStatus::Active);
        // Beta(1, 1 + f) is above 0.1 with probability 0.9^(f + 1): 0.0471 for 28 failures, 0.0581 for 26.
        assert_eq!(history_of(&[0.0; 13]).status, LayoutStatus::Active);
        assert_eq!(history_of(&[0.0; 14]).status, LayoutStatus::Hopeless);
    }

    /// Two groups try a layout; then it is served while the agent succeeds on it sometimes.
    #[test]
    fn layout_is_served_at_the_edge_of_ability() {
        for (values, is_served) in [
            (&[][..], true),
            (&[0.0], true),
            (&[0.0, 0.0], false),
            (&[0.0, 0.5], true),
            (&[0.5, 1.0], true),
            (&[1.0, 1.0], false),
        ] {
            assert_eq!(history_of(values).is_served(), is_served, "{values:?}");
        }
        assert!(!LayoutHistory { status: LayoutStatus::RetiredByUser, ..history_of(&[0.5; 4]) }.is_served());
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
        fn status_follows_outcomes(
            values in proptest::collection::vec((0u32..=4).prop_map(|n| f64::from(n) / 4.0), 0..120), group_size in 1u32..=8,
        ) {
            let mut history = LayoutHistory::new(group_size);
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
                        let n = window.len() as f64 * f64::from(group_size);
                        let mean = (1.0 + window.iter().sum::<f64>() * f64::from(group_size)) / (2.0 + n);
                        prop_assert!(window.len() >= TRIAL_OUTCOMES && mean >= MASTERED_FROM);
                    }
                    (LayoutStatus::Active, LayoutStatus::Hopeless) => {
                        prop_assert!(history.success().quantile(0.95) < HOPELESS_SUCCESS && value < 0.25);
                    }
                    (LayoutStatus::Mastered, LayoutStatus::Active) => prop_assert!(value < FORGOTTEN_BELOW),
                    (LayoutStatus::Hopeless, LayoutStatus::Active) => prop_assert!(value > 0.0),
                    (before, after) => prop_assert_eq!(before, after),
                }
            }
        }

        /// A number that is no success rate counts as failure.
        #[test]
        fn any_number_is_accepted(bits in proptest::collection::vec(any::<u64>(), 0..60)) {
            let mut history = LayoutHistory::new(1);
            for bits in bits {
                history.observe(f64::from_bits(bits));
                prop_assert!(history.recent.iter().all(|v| (0.0..=1.0).contains(v)));
            }
        }
    }
}
