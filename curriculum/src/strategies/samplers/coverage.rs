//! Coverage: a share of the steps that is drawn uniformly from all rungs, so that the agent does not forget what it no longer
//! meets.
//!
//! The share is one of steps, not of episodes: while the agent is at easy rungs, an episode of a hard one can be thirty times
//! as long.

use serde::{Deserialize, Serialize};

use super::episode_length::EpisodeLength;

/// Lengths of the episodes drawn for coverage, and of the others.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Coverage {
    others: EpisodeLength,
    drawn: EpisodeLength,
}

impl Coverage {
    /// Probability with which the next proposal must be drawn for coverage, so that such episodes have this share of the steps.
    /// `longest` is the length that is assumed while none has ended.
    ///
    /// With probability p and mean lengths a of these and b of the others, the share is pa/(pa + (1 − p)b).
    pub(super) fn probability(&self, share: f64, longest: impl Fn() -> f64) -> f64 {
        let Some(other) = self.others.mean() else { return 0.0 };
        let drawn = self.drawn.mean().unwrap_or_else(longest);
        let (wanted, rest) = (share * other, (1.0 - share) * drawn);
        if wanted > 0.0 { wanted / (wanted + rest) } else { 0.0 }
    }

    /// Takes note of episodes and their steps together.
    pub(super) fn observe(&mut self, is_coverage: bool, steps: u64, episodes: u32) {
        let length = if is_coverage { &mut self.drawn } else { &mut self.others };
        length.add(steps, episodes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawn_episodes_have_their_share_of_the_steps() {
        let mut coverage = Coverage::default();
        assert_eq!(coverage.probability(0.03, || 1000.0), 0.0);
        coverage.observe(false, 400, 10);
        // While none has ended, the longest length is assumed.
        let p = coverage.probability(0.03, || 1000.0);
        assert!((p * 1000.0 / (p * 1000.0 + (1.0 - p) * 40.0) - 0.03).abs() < 1e-12);
        coverage.observe(true, 160, 2);
        let p = coverage.probability(0.03, || 1000.0);
        assert!((p * 80.0 / (p * 80.0 + (1.0 - p) * 40.0) - 0.03).abs() < 1e-12);
        assert_eq!(coverage.probability(0.0, || 1.0), 0.0);
        assert_eq!(coverage.probability(1.0, || 1.0), 1.0);
    }
}
