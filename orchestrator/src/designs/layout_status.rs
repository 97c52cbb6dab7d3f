//! Status of layouts: when one retires and when it is put back, decided from its last outcomes alone.

use curriculum::Posterior;
use serde::{Deserialize, Serialize};
use store::layout_transitions::LayoutTransition;
use store::layouts::{LayoutState, RetirementReason};

/// Number of outcomes in the window.
pub const OUTCOME_WINDOW: usize = 16;
/// Number of outcomes before which a layout does not retire.
pub const TRIAL_OUTCOMES: usize = 2;
/// Success rate from which a layout is mastered.
pub const MASTERED_FROM: f64 = 0.8;
/// Success rate below which a layout is hopeless.
pub const HOPELESS_BELOW: f64 = 0.2;
/// Success rate of a group on a mastered layout below which the agent has forgotten it.
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
    /// The server judges it otherwise than the worker that designed it; it is never served.
    Wrong,
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
            (LayoutState::Retired, Some(RetirementReason::Wrong)) => Some(Self::Wrong),
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
            Self::Wrong => (LayoutState::Retired, Some(RetirementReason::Wrong)),
        };
        LayoutTransition { state, retirement_reason, reason }
    }
}

/// Result of a group on a layout.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct RecentResult {
    /// Number of successes, 0 to `episodes`.
    pub successes: f64,
    /// Number of finished episodes, at least 1.
    pub episodes: u32,
}

impl RecentResult {
    /// Success rate of the group.
    #[must_use]
    pub fn success_rate(self) -> f64 {
        self.successes / f64::from(self.episodes.max(1))
    }
}

/// Status and last results of a layout.
#[derive(Debug, Clone, PartialEq)]
pub struct LayoutHistory {
    /// Status of the layout.
    pub status: LayoutStatus,
    /// Results of its last groups, oldest first.
    pub recent: Vec<RecentResult>,
}

impl LayoutHistory {
    /// Returns the history of a new layout.
    #[must_use]
    pub const fn new() -> Self {
        Self { status: LayoutStatus::Active, recent: Vec::new() }
    }

    /// Adds the result of a group. Returns the reason if the status changes.
    pub fn observe(&mut self, result: RecentResult) -> Option<String> {
        let rate = result.success_rate();
        let reason = match self.status {
            LayoutStatus::Mastered if rate < FORGOTTEN_BELOW => {
                Some(format!("reactivated: success fell to {rate:.2} after mastery"))
            }
            LayoutStatus::Hopeless if rate > 0.0 => {
                Some(format!("reactivated: success rose to {rate:.2} after hardly any success"))
            }
            _ => None,
        };
        if reason.is_some() {
            *self = Self { status: LayoutStatus::Active, recent: vec![result] };
            return reason;
        }
        if self.recent.len() >= OUTCOME_WINDOW {
            self.recent.drain(..=self.recent.len() - OUTCOME_WINDOW);
        }
        self.recent.push(result);
        if self.status != LayoutStatus::Active {
            return None;
        }
        let (status, reason) = self.retirement()?;
        self.status = status;
        Some(reason)
    }

    /// Returns the new status of an active layout that retires, and the reason.
    fn retirement(&self) -> Option<(LayoutStatus, String)> {
        let (mean, groups) = (success_posterior(&self.recent).mean(), self.recent.len());
        let (status, name) = match mean {
            _ if groups < TRIAL_OUTCOMES => return None,
            MASTERED_FROM.. => (LayoutStatus::Mastered, "mastered"),
            ..HOPELESS_BELOW => (LayoutStatus::Hopeless, "hopeless"),
            _ => return None,
        };
        Some((status, format!("{name}: its success rate is {mean:.2} by its last {groups} groups")))
    }
}

impl Default for LayoutHistory {
    fn default() -> Self {
        Self::new()
    }
}

/// Posterior over the success rate of the agent on a layout. Its episodes are independent, since they share the scenario.
#[must_use]
pub fn success_posterior(recent: &[RecentResult]) -> Posterior {
    let n = recent.iter().fold(0u32, |n, result| n.saturating_add(result.episodes));
    Posterior { n, sum: recent.iter().map(|result| result.successes).sum() }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// History of a layout after groups of a size with these numbers of successes.
    fn history_of(episodes: u32, successes: &[u32]) -> LayoutHistory {
        let mut history = LayoutHistory::new();
        for successes in successes {
            history.observe(RecentResult { successes: f64::from(*successes), episodes });
        }
        history
    }

    /// The mean of Beta(1 + s, 1 + f) after s successes and f failures is (1 + s)/(2 + s + f).
    #[test]
    fn layout_retires_once_mastered_or_hopeless() {
        use LayoutStatus::{Active, Hopeless, Mastered};
        for (episodes, successes, status) in [
            (2, &[][..], Active),
            (2, &[0], Active),
            (2, &[2], Active),
            (2, &[2, 2], Mastered),       // 5/6
            (2, &[1, 2], Active),         // 4/6
            (2, &[2, 1, 2, 2], Mastered), // 8/10
            (2, &[0, 0], Hopeless),       // 1/6
            (2, &[0, 1], Active),         // 2/6
            (1, &[1, 1], Active),         // 3/4
            (1, &[1, 1, 1], Mastered),    // 4/5
            (1, &[0, 0, 0], Active),      // 1/5
            (1, &[0, 0, 0, 0], Hopeless), // 1/6
            (8, &[0], Active),
            (8, &[0, 1], Hopeless), // 2/18
        ] {
            assert_eq!(history_of(episodes, successes).status, status, "{episodes} {successes:?}");
        }
    }

    #[test]
    fn contradicting_probe_reactivates_with_empty_window() {
        let mut mastered = history_of(4, &[4; 12]);
        assert_eq!(mastered.observe(RecentResult { successes: 2.0, episodes: 4 }), None);
        assert_eq!(mastered.status, LayoutStatus::Mastered);
        let one = RecentResult { successes: 1.0, episodes: 4 };
        assert!(mastered.observe(one).unwrap().contains("fell to 0.25"));
        assert_eq!((mastered.status, mastered.recent.as_slice()), (LayoutStatus::Active, &[one][..]));

        let mut hopeless = history_of(8, &[0; 30]);
        assert_eq!(hopeless.observe(RecentResult { successes: 0.0, episodes: 8 }), None);
        let one = RecentResult { successes: 1.0, episodes: 8 };
        assert!(hopeless.observe(one).unwrap().contains("rose to 0.12"));
        assert_eq!((hopeless.status, hopeless.recent.as_slice()), (LayoutStatus::Active, &[one][..]));
    }

    #[test]
    fn manually_retired_layout_stays_retired() {
        let mut history =
            LayoutHistory { status: LayoutStatus::RetiredByUser, ..history_of(2, &[1, 1, 1, 1]) };
        for successes in [0.0, 2.0].into_iter().cycle().take(200) {
            assert_eq!(history.observe(RecentResult { successes, episodes: 2 }), None);
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
            LayoutStatus::Wrong,
        ] {
            let stored = status.transition(String::new());
            assert_eq!(LayoutStatus::from_stored(stored.state, stored.retirement_reason), Some(status));
        }
        assert_eq!(LayoutStatus::from_stored(LayoutState::Refused, None), None);
    }

    proptest! {
        /// The window has the last results since the layout started or was put back, at most 16. It is retired only on
        /// evidence, and a reason is returned for each change of status.
        #[test]
        fn status_follows_results(
            results in proptest::collection::vec((1u32..=8, 0u32..=8), 0..120)
        ) {
            let results: Vec<RecentResult> = results
                .into_iter()
                .map(|(episodes, successes)| RecentResult { successes: f64::from(successes.min(episodes)), episodes })
                .collect();
            let (mut history, mut since) = (LayoutHistory::new(), 0);
            for (at, &result) in results.iter().enumerate() {
                let before = history.status;
                let reason = history.observe(result);
                prop_assert_eq!(reason.is_some(), history.status != before);
                if before != LayoutStatus::Active && history.status == LayoutStatus::Active {
                    since = at;
                }
                let window = &results[since.max((at + 1).saturating_sub(OUTCOME_WINDOW))..=at];
                prop_assert_eq!(history.recent.as_slice(), window);
                let successes: f64 = window.iter().map(|result| result.successes).sum();
                let episodes: u32 = window.iter().map(|result| result.episodes).sum();
                let mean = (1.0 + successes) / (2.0 + f64::from(episodes));
                match (before, history.status) {
                    (LayoutStatus::Active, LayoutStatus::Mastered) => prop_assert!(window.len() >= 2 && mean >= 0.8),
                    (LayoutStatus::Active, LayoutStatus::Hopeless) => prop_assert!(window.len() >= 2 && mean < 0.2),
                    (LayoutStatus::Active, LayoutStatus::Active) => prop_assert!(window.len() < 2 || (0.2..0.8).contains(&mean)),
                    (LayoutStatus::Mastered, LayoutStatus::Active) => prop_assert!(result.success_rate() < FORGOTTEN_BELOW),
                    (LayoutStatus::Hopeless, LayoutStatus::Active) => prop_assert!(result.successes > 0.0),
                    (before, after) => prop_assert_eq!(before, after),
                }
            }
        }
    }
}
