//! The value of a slot: an interval of success rates that contains the true one, whatever the missing episodes did.

use serde::{Deserialize, Serialize};

/// Bounds of the success rate of a group of which some episodes are missing (Manski 1989): `low` counts a missing
/// episode as a failure, `high` counts it as a success. Both are equal if no episode is missing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SuccessInterval {
    /// Success rate if every missing episode failed, 0 to 1.
    pub low: f64,
    /// Success rate if every missing episode succeeded, 0 to 1.
    pub high: f64,
}

/// Number of episodes of a group, by result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EpisodeTally {
    /// Number of episodes in the group.
    pub size: u32,
    /// Number of episodes with a result that counts.
    pub finished: u32,
    /// Number of successes among them.
    pub successes: u32,
    /// Number of episodes whose first attempt was abandoned, whether a later attempt has a result or not.
    pub abandoned: u32,
}

impl SuccessInterval {
    /// Interval of a group without any result.
    pub const MISSING: Self = Self { low: 0.0, high: 1.0 };

    /// Interval of a group with these episodes. It is unknown which results are of a second attempt, so as many as were
    /// abandoned may be.
    #[must_use]
    pub fn of_episodes(episodes: EpisodeTally) -> Self {
        let size = episodes.size.max(1);
        let finished = episodes.finished.min(size);
        let successes = episodes.successes.min(finished);
        let failures = finished - successes;
        let certain_successes = successes.saturating_sub(episodes.abandoned);
        let certain_failures = failures.saturating_sub(episodes.abandoned);
        Self {
            low: f64::from(certain_successes) / f64::from(size),
            high: f64::from(size - certain_failures) / f64::from(size),
        }
    }

    /// Share of the episodes that are missing, 0 to 1.
    #[must_use]
    pub fn missing(self) -> f64 {
        self.high - self.low
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn interval(size: u32, finished: u32, successes: u32, abandoned: u32) -> (f64, f64) {
        let tally = EpisodeTally { size, finished, successes, abandoned };
        let SuccessInterval { low, high } = SuccessInterval::of_episodes(tally);
        (low, high)
    }

    #[test]
    fn missing_episodes_widen_the_interval() {
        assert_eq!(interval(8, 8, 6, 0), (0.75, 0.75));
        assert_eq!(interval(8, 6, 6, 0), (0.75, 1.0));
        assert_eq!(interval(8, 0, 0, 0), (0.0, 1.0));
        assert_eq!(SuccessInterval::MISSING.missing(), 1.0);
    }

    #[test]
    fn second_attempt_never_raises_the_worst_case() {
        // A success of a second attempt, and the same episode still missing.
        assert_eq!(interval(1, 1, 1, 1), (0.0, 1.0));
        assert_eq!(interval(1, 0, 0, 1), (0.0, 1.0));
        // Seven first attempts and one second attempt, which succeeded.
        assert_eq!(interval(8, 8, 8, 1), (0.875, 1.0));
        assert_eq!(interval(8, 8, 2, 9), (0.0, 1.0));
    }

    #[test]
    fn impossible_counts_stay_within_bounds() {
        assert_eq!(interval(2, 9, 9, 0), (1.0, 1.0));
        assert_eq!(interval(0, 0, 0, 0), (0.0, 1.0));
    }
}
