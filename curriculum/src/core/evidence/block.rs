//! Blocks of contested outcomes: the evidence that a level move rests on.
//!
//! One contested scenario is one observation. A rule that looks at a sliding window after every observation is a
//! sequential test without a correction, and promotes almost every learner in time (optional stopping: Armitage,
//! McPherson and Rowe 1969). Observations are therefore gathered into disjoint blocks, and the rule looks only when a
//! block is full.

use serde::{Deserialize, Serialize};

use super::level_move::BlockSummary;
use super::posterior::Posterior;
use crate::core::outcome::GroupOutcome;
use crate::core::settings::Target;

/// Number of scenarios in a full block.
pub(crate) const BLOCK_SIZE: u32 = 32;
/// Lowest 10 % quantile of a block at which its level is mastered (26 of 32).
pub(crate) const MASTERED_Q10: f64 = 0.70;
/// Highest 90 % quantile of a block at which its level is out of reach (6 of 32).
pub(crate) const OUT_OF_REACH_Q90: f64 = 0.30;
/// Mean of a block above which `target: half` moves up.
pub(crate) const HALF_UP_MEAN: f64 = 0.7;
/// Mean of a block below which `target: half` moves down.
pub(crate) const HALF_DOWN_MEAN: f64 = 0.3;
/// Largest share of a block's episodes that may be lost. A block above it is discarded: a trainer that loses the
/// episodes it would have failed must not look good.
const MAX_LOST_SHARE: f64 = 0.10;
/// Number of lost episodes from which a filling block that would be discarded causes a warning.
const MIN_LOST_FOR_WARNING: u32 = 8;

/// Observations gathered so far, with the episodes behind them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct EvidenceBlock {
    /// Number of scenarios with a success rate.
    pub(crate) n: u32,
    /// Sum of their success rates.
    pub(crate) sum: f64,
    /// Number of episodes that finished.
    pub(crate) finished: u32,
    /// Number of episodes that failed or expired, those of scenarios without a success rate included.
    pub(crate) lost: u32,
    /// Seq of the earliest proposal in the block; `None` while the block is empty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) first: Option<u64>,
}

impl EvidenceBlock {
    /// Records a contested outcome. Returns the block once it holds `size` observations, and starts a new one; a full
    /// block that lost too many episodes is counted in `discarded` instead.
    pub(crate) fn record_until_full(
        &mut self,
        outcome: &GroupOutcome,
        size: u32,
        discarded: &mut DiscardedBlocks,
    ) -> Option<Self> {
        self.record(outcome);
        if self.n < size {
            return None;
        }
        let full = std::mem::take(self);
        if full.is_lossy() {
            discarded.add(&full);
            return None;
        }
        Some(full)
    }

    /// Records a contested outcome. A group that was lost as a whole is no observation, but its episodes count as
    /// lost.
    fn record(&mut self, outcome: &GroupOutcome) {
        self.finished = self.finished.saturating_add(outcome.finished);
        self.lost = self.lost.saturating_add(outcome.lost_episodes());
        if self.n == 0 || self.first.is_some() {
            self.first = Some(self.first.map_or(outcome.proposal, |first| first.min(outcome.proposal)));
        }
        if let Some(success_rate) = outcome.success_rate() {
            self.n += 1;
            self.sum += success_rate;
        }
    }

    /// True if too many episodes were lost for the block to count.
    fn is_lossy(&self) -> bool {
        f64::from(self.lost) > MAX_LOST_SHARE * (f64::from(self.finished) + f64::from(self.lost))
    }

    /// Seq of the earliest proposal that the block can rest on; `None` while the block is empty, 0 if it is unknown.
    pub(crate) fn earliest_proposal(&self) -> Option<u64> {
        let has_begun = self.n > 0 || self.lost > 0;
        has_begun.then(|| self.first.unwrap_or(0))
    }

    /// Mean success rate; 0 while the block is empty.
    pub(crate) fn mean(&self) -> f64 {
        if self.n == 0 { 0.0 } else { self.sum / f64::from(self.n) }
    }

    const fn posterior(&self) -> Posterior {
        Posterior { n: self.n, sum: self.sum }
    }

    pub(crate) fn q10(&self) -> f64 {
        self.posterior().quantile(0.10)
    }

    pub(crate) fn q90(&self) -> f64 {
        self.posterior().quantile(0.90)
    }

    fn is_mastered(&self) -> bool {
        self.q10() >= MASTERED_Q10
    }

    fn is_out_of_reach(&self) -> bool {
        self.q90() <= OUT_OF_REACH_Q90
    }

    pub(crate) fn summary(&self) -> BlockSummary {
        BlockSummary {
            n: self.n,
            sum: self.sum,
            mean: self.mean(),
            q10: self.q10(),
            q90: self.q90(),
            finished: self.finished,
            lost: self.lost,
            first: self.first,
        }
    }
}

/// Level change that full blocks call for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BlockVerdict {
    Up,
    Down,
    Stay,
}

/// Judges a full block together with the full block before it at the same level, if there is one.
pub(crate) fn judge_blocks(
    target: Target,
    previous: Option<&EvidenceBlock>,
    full: &EvidenceBlock,
) -> BlockVerdict {
    match target {
        Target::Half if full.mean() > HALF_UP_MEAN => BlockVerdict::Up,
        Target::Half if full.mean() < HALF_DOWN_MEAN => BlockVerdict::Down,
        Target::Half => BlockVerdict::Stay,
        Target::Mastery => match previous {
            Some(previous) if previous.is_mastered() && full.is_mastered() => BlockVerdict::Up,
            Some(previous) if previous.is_out_of_reach() && full.is_out_of_reach() => BlockVerdict::Down,
            _ => BlockVerdict::Stay,
        },
    }
}

/// Full blocks that were discarded since the last move, with the episode counts of the latest one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct DiscardedBlocks {
    pub(crate) count: u32,
    finished: u32,
    lost: u32,
}

impl DiscardedBlocks {
    fn add(&mut self, block: &EvidenceBlock) {
        *self = Self { count: self.count.saturating_add(1), finished: block.finished, lost: block.lost };
    }
}

/// Warns about lost episodes: in the blocks discarded for them, and in the block that is filling. `noun` names a
/// block ("block", "probe"); `scope` is appended to it (" at this level").
pub(crate) fn loss_warnings(
    noun: &str,
    scope: &str,
    discarded: &DiscardedBlocks,
    filling: &EvidenceBlock,
) -> Vec<String> {
    let mut warnings = Vec::new();
    if discarded.count > 0 {
        let (plural, were) = if discarded.count == 1 { ("", "was") } else { ("s", "were") };
        warnings.push(format!(
            "{} {noun}{plural}{scope} {were} discarded, because more than 10 % of the episodes failed or \
             expired ({} of {} the last time); nothing moves on such evidence",
            discarded.count,
            discarded.lost,
            u64::from(discarded.lost) + u64::from(discarded.finished),
        ));
    }
    if filling.lost >= MIN_LOST_FOR_WARNING && filling.is_lossy() {
        warnings.push(format!(
            "{} of the {} episodes in the current {noun} failed or expired; above 10 % it will not count",
            filling.lost,
            u64::from(filling.lost) + u64::from(filling.finished),
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full_block(sum: f64) -> EvidenceBlock {
        EvidenceBlock { n: BLOCK_SIZE, sum, finished: BLOCK_SIZE, lost: 0, first: Some(0) }
    }

    #[test]
    fn mastery_takes_26_of_32_and_out_of_reach_6() {
        assert!(full_block(26.0).is_mastered(), "{}", full_block(26.0).q10());
        assert!(!full_block(25.0).is_mastered(), "{}", full_block(25.0).q10());
        assert!(full_block(6.0).is_out_of_reach(), "{}", full_block(6.0).q90());
        assert!(!full_block(7.0).is_out_of_reach(), "{}", full_block(7.0).q90());
    }

    #[test]
    fn mastery_target_moves_on_two_consecutive_blocks() {
        let verdict = |previous: Option<f64>, full: f64| {
            judge_blocks(Target::Mastery, previous.map(full_block).as_ref(), &full_block(full))
        };
        assert_eq!(verdict(None, 32.0), BlockVerdict::Stay);
        assert_eq!(verdict(Some(26.0), 26.0), BlockVerdict::Up);
        assert_eq!(verdict(Some(25.0), 32.0), BlockVerdict::Stay);
        assert_eq!(verdict(Some(32.0), 25.0), BlockVerdict::Stay);
        assert_eq!(verdict(Some(6.0), 6.0), BlockVerdict::Down);
        assert_eq!(verdict(Some(7.0), 0.0), BlockVerdict::Stay);
        assert_eq!(verdict(Some(32.0), 0.0), BlockVerdict::Stay);
        assert_eq!(verdict(None, 0.0), BlockVerdict::Stay);
    }

    #[test]
    fn half_target_moves_on_one_block_strictly_outside_bounds() {
        let verdict = |sum: f64| judge_blocks(Target::Half, None, &full_block(sum));
        assert_eq!(verdict(22.5), BlockVerdict::Up);
        assert_eq!(verdict(22.375), BlockVerdict::Stay); // mean 0.699
        assert_eq!(verdict(16.0), BlockVerdict::Stay);
        assert_eq!(verdict(9.625), BlockVerdict::Stay); // mean 0.301
        assert_eq!(verdict(9.5), BlockVerdict::Down);
    }

    #[test]
    fn block_is_lossy_above_a_tenth_of_lost_episodes() {
        assert!(!EvidenceBlock { finished: 90, lost: 10, ..EvidenceBlock::default() }.is_lossy());
        assert!(EvidenceBlock { finished: 89, lost: 10, ..EvidenceBlock::default() }.is_lossy());
        assert!(!EvidenceBlock::default().is_lossy());
    }
}
