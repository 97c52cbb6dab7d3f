//! Decides the share of designed groups by what the agent learns from them, compared with ordinary groups: two arms of a bandit.
//!
//! The learning signal of a group is the variance of success within it: in groups without variance, a trainer that compares
//! episodes of a scenario learns nothing. A group of one episode has no variance; its signal is the squared distance of its success
//! from the mean of its arm. The share is the largest one, times the probability that the mean signal of designed groups is higher
//! (Thompson 1933, with normal distributions). Both arms fade, so that an arm without groups is tried again.

use store::learning_signals::{LearningSignalSums, SignalSums};

/// Number of groups of a run after which a group counts half.
const HALF_LIFE_GROUPS: f64 = 256.0;
/// Number of groups that the prior counts as.
const PRIOR_WEIGHT: f64 = 4.0;
/// Prior mean of the signal: that of p(1 − p) for a success rate p that is uniform.
const PRIOR_MEAN: f64 = 1.0 / 6.0;
/// Prior mean of the squared signal: that of p²(1 − p)² for a success rate p that is uniform.
const PRIOR_SQUARE: f64 = 1.0 / 30.0;

/// Results of a training group.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalGroup {
    /// True if the group is on a designed layout.
    pub is_designed: bool,
    /// Number of finished episodes, at least 1.
    pub finished: u32,
    /// Number of successful episodes.
    pub successes: u32,
}

/// Adds a group to the sums. Both kinds fade with every group of the run.
pub fn add_group(sums: &mut LearningSignalSums, group: SignalGroup) {
    let kept = libm::exp2(-1.0 / HALF_LIFE_GROUPS);
    fade(&mut sums.ordinary, kept);
    fade(&mut sums.designed, kept);
    let arm = if group.is_designed { &mut sums.designed } else { &mut sums.ordinary };
    let episodes = f64::from(group.finished.max(1));
    let success = f64::from(group.successes.min(group.finished)) / episodes;
    let signal = if group.finished > 1 {
        success * (1.0 - success) * episodes / (episodes - 1.0)
    } else {
        let mean = (arm.success_sum + PRIOR_WEIGHT / 2.0) / (arm.weight + PRIOR_WEIGHT);
        (success - mean) * (success - mean)
    };
    arm.weight += 1.0;
    arm.success_sum += success;
    arm.signal_sum += signal;
    arm.signal_sq_sum += signal * signal;
}

/// Returns the share of groups that are designed, from 0 to `largest`.
#[must_use]
pub fn designed_share(sums: &LearningSignalSums, largest: f64) -> f64 {
    let (designed, ordinary) = (ArmValue::of(sums.designed), ArmValue::of(sums.ordinary));
    let spread = libm::sqrt(designed.error_sq + ordinary.error_sq).max(f64::MIN_POSITIVE);
    largest * normal_cdf((designed.mean - ordinary.mean) / spread)
}

/// Mean learning signal of an arm, with the squared standard error of the mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmValue {
    /// Mean signal, 0 to 0.5.
    pub mean: f64,
    /// Square of the standard error of the mean.
    pub error_sq: f64,
}

impl ArmValue {
    /// Value of an arm with these sums.
    #[must_use]
    pub fn of(sums: SignalSums) -> Self {
        let weight = sums.weight + PRIOR_WEIGHT;
        let mean = (sums.signal_sum + PRIOR_WEIGHT * PRIOR_MEAN) / weight;
        let square = (sums.signal_sq_sum + PRIOR_WEIGHT * PRIOR_SQUARE) / weight;
        Self { mean, error_sq: (square - mean * mean).max(0.0) / weight }
    }
}

fn fade(sums: &mut SignalSums, kept: f64) {
    sums.weight *= kept;
    sums.success_sum *= kept;
    sums.signal_sum *= kept;
    sums.signal_sq_sum *= kept;
}

/// Probability that a standard normal variable is below `x`.
fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x / std::f64::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Sums after groups of eight episodes with these numbers of successes, alternately designed and ordinary.
    fn after(designed: &[u32], ordinary: &[u32]) -> LearningSignalSums {
        let mut sums = LearningSignalSums::default();
        for (designed, ordinary) in designed.iter().zip(ordinary) {
            for (is_designed, successes) in [(true, *designed), (false, *ordinary)] {
                add_group(&mut sums, SignalGroup { is_designed, finished: 8, successes });
            }
        }
        sums
    }

    #[test]
    fn share_is_half_of_the_largest_without_results() {
        assert!((designed_share(&LearningSignalSums::default(), 0.3) - 0.15).abs() < 1e-12);
    }

    #[test]
    fn share_follows_the_variance_within_groups() {
        let (mixed, flat) = ([4, 3, 5, 4].repeat(16), [8, 0, 8, 8].repeat(16));
        assert!(designed_share(&after(&mixed, &flat), 0.3) > 0.299);
        assert!(designed_share(&after(&flat, &mixed), 0.3) < 0.001);
        assert!((designed_share(&after(&mixed, &mixed), 0.3) - 0.15).abs() < 0.01);
    }

    /// An arm that was worse and has had no group since is tried again.
    #[test]
    fn arm_without_groups_is_tried_again() {
        let mut sums = after(&[0; 64], &[4; 64]);
        let before = designed_share(&sums, 0.3);
        (0..2560).for_each(|_| {
            add_group(&mut sums, SignalGroup { is_designed: false, finished: 8, successes: 1 });
        });
        let later = designed_share(&sums, 0.3);
        assert!(before < 0.001 && later > 0.1, "{before} {later}");
    }

    /// For single episodes the mean signal approaches the variance p(1 − p) of success.
    #[test]
    fn signal_of_single_episodes_is_the_variance_of_success() {
        let mut sums = LearningSignalSums::default();
        for number in 0..4000u32 {
            add_group(
                &mut sums,
                SignalGroup { is_designed: true, finished: 1, successes: u32::from(number % 5 == 0) },
            );
        }
        assert!((ArmValue::of(sums.designed).mean - 0.16).abs() < 0.01);
    }

    #[test]
    fn normal_distribution_matches_known_values() {
        for (x, p) in [(0.0, 0.5), (1.0, 0.841_344_746_068_543), (-1.959_963_984_540_054, 0.025)] {
            assert!((normal_cdf(x) - p).abs() < 1e-12, "{x}");
        }
    }

    proptest! {
        /// The share is within its bounds, whatever the results.
        #[test]
        fn share_is_bounded(groups in proptest::collection::vec((any::<bool>(), 1u32..9, 0u32..9), 0..300), largest in 0.0f64..=1.0) {
            let mut sums = LearningSignalSums::default();
            for (is_designed, finished, successes) in groups {
                add_group(&mut sums, SignalGroup { is_designed, finished, successes });
            }
            let share = designed_share(&sums, largest);
            prop_assert!((0.0..=largest).contains(&share), "{share} of {largest}");
        }
    }
}
