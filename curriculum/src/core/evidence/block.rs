//! Blocks of settled slots: the evidence that a level move rests on.
//!
//! One contested scenario is one observation, an interval of success rates. A block moves a level up only if its worst
//! case allows it, and down only if its best case does (intention to treat, with the bounds of Manski 1989). A rule that
//! looks at a sliding window after every observation is a sequential test without a correction, and promotes almost
//! every learner in time (optional stopping: Armitage, McPherson and Rowe 1969). Observations are therefore gathered
//! into disjoint blocks, and the rule looks only when a block is full.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use super::level_move::BlockSummary;
use super::posterior::Posterior;
use super::slot_queue::SettledSlot;
use crate::core::settings::Target;
use crate::core::settings::hyperparameters::adr;

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
/// Share of missing outcomes above which a task causes a warning.
pub(crate) const MISSING_WARNING_SHARE: f64 = 0.10;
/// Number of slots from which missing outcomes cause a warning.
pub(crate) const MIN_SLOTS_FOR_WARNING: u32 = 8;

/// Largest number of slots of a stored block. Only blocks of ADR have a size that the settings select.
const MAX_STORED_SLOTS: u32 = adr::BUFFER.range.max_whole();

/// Settled slots of one level, up to the size of a block.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct EvidenceBlock {
    /// Number of slots in the block.
    #[serde(deserialize_with = "slot_count")]
    pub(crate) n: u32,
    /// Sum of the low ends of their intervals.
    pub(crate) low: f64,
    /// Sum of the high ends of their intervals.
    pub(crate) high: f64,
    /// Seq of the earliest proposal in the block; `None` while the block is empty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) first: Option<u64>,
}

impl EvidenceBlock {
    /// Adds a settled slot. Returns the block once it has `size` slots, and starts a new one.
    pub(crate) fn record_until_full(&mut self, slot: SettledSlot, size: u32) -> Option<Self> {
        self.n = self.n.saturating_add(1);
        self.low += slot.value.low;
        self.high += slot.value.high;
        self.first = Some(self.first.map_or(slot.proposal, |first| first.min(slot.proposal)));
        (self.n >= size).then(|| std::mem::take(self))
    }

    /// Mean success rate if every missing episode failed; 0 while the block is empty.
    pub(crate) fn mean_low(&self) -> f64 {
        if self.n == 0 { 0.0 } else { self.low / f64::from(self.n) }
    }

    /// Mean success rate if every missing episode succeeded; 1 while the block is empty.
    pub(crate) fn mean_high(&self) -> f64 {
        if self.n == 0 { 1.0 } else { self.high / f64::from(self.n) }
    }

    /// Number of missing outcomes; a group of which a part is missing counts as that part.
    pub(crate) fn missing(&self) -> f64 {
        self.high - self.low
    }

    /// Share of the outcomes that are missing; 0 while the block is empty.
    pub(crate) fn missing_share(&self) -> f64 {
        if self.n == 0 { 0.0 } else { self.missing() / f64::from(self.n) }
    }

    /// 10 % quantile of the posterior in the worst case.
    pub(crate) fn q10(&self) -> f64 {
        Posterior { n: self.n, sum: self.low }.quantile(0.10)
    }

    /// 90 % quantile of the posterior in the best case.
    pub(crate) fn q90(&self) -> f64 {
        Posterior { n: self.n, sum: self.high }.quantile(0.90)
    }

    fn is_mastered(&self) -> bool {
        self.q10() >= MASTERED_Q10
    }

    fn is_out_of_reach(&self) -> bool {
        self.q90() <= OUT_OF_REACH_Q90
    }

    /// The same block if every missing episode had succeeded.
    fn best_case(&self) -> Self {
        Self { low: self.high, ..*self }
    }

    pub(crate) fn summary(&self) -> BlockSummary {
        BlockSummary {
            n: self.n,
            low: self.low,
            high: self.high,
            mean: self.mean_low(),
            q10: self.q10(),
            q90: self.q90(),
            missing: self.missing_share(),
            first: self.first,
        }
    }
}

/// Reads a number of slots. The quantiles of a block with billions of slots, which only a damaged snapshot has, would not
/// converge.
fn slot_count<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    let n = u32::deserialize(deserializer)?;
    if n > MAX_STORED_SLOTS {
        return Err(D::Error::custom(format!("a block has at most {MAX_STORED_SLOTS} slots, got {n}")));
    }
    Ok(n)
}

/// Sentence that says how missing outcomes hold a promotion back, if they do: the full block does not call for it, and
/// would call for it if the missing episodes had succeeded.
pub(crate) fn promotion_hold(target: Target, full: &EvidenceBlock) -> Option<String> {
    let (is_held, worst, needed) = match target {
        Target::Mastery => {
            let is_held = !full.is_mastered() && full.best_case().is_mastered();
            (is_held, format!("the worst case has a 10 % quantile of {:.2}", full.q10()), MASTERED_Q10)
        }
        Target::Half => {
            let is_held = full.mean_low() <= HALF_UP_MEAN && full.mean_high() > HALF_UP_MEAN;
            (is_held, format!("the worst case has a mean of {:.2}", full.mean_low()), HALF_UP_MEAN)
        }
    };
    let missing = format_count(full.missing());
    is_held.then(|| {
        format!(
            "{missing} of {} outcomes of the last block are missing: {worst}, {needed:.2} is needed",
            full.n
        )
    })
}

/// A count with at most one decimal: "7", "7.5".
pub(crate) fn format_count(count: f64) -> String {
    let rounded = (10.0 * count).round() / 10.0;
    if rounded.fract() == 0.0 { format!("{rounded:.0}") } else { format!("{rounded:.1}") }
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
        Target::Half if full.mean_low() > HALF_UP_MEAN => BlockVerdict::Up,
        Target::Half if full.mean_high() < HALF_DOWN_MEAN => BlockVerdict::Down,
        Target::Half => BlockVerdict::Stay,
        Target::Mastery => match previous {
            Some(previous) if previous.is_mastered() && full.is_mastered() => BlockVerdict::Up,
            Some(previous) if previous.is_out_of_reach() && full.is_out_of_reach() => BlockVerdict::Down,
            _ => BlockVerdict::Stay,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full_block(sum: f64) -> EvidenceBlock {
        EvidenceBlock { n: BLOCK_SIZE, low: sum, high: sum, first: Some(0) }
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
    fn moves_up_use_the_worst_case_and_moves_down_the_best() {
        let block = |low: f64, high: f64| EvidenceBlock { high, ..full_block(low) };
        let verdict = |target, block: EvidenceBlock| judge_blocks(target, Some(&block), &block);
        assert_eq!(verdict(Target::Mastery, block(26.0, 32.0)), BlockVerdict::Up);
        assert_eq!(verdict(Target::Mastery, block(25.0, 32.0)), BlockVerdict::Stay);
        assert_eq!(verdict(Target::Mastery, block(0.0, 6.0)), BlockVerdict::Down);
        assert_eq!(verdict(Target::Mastery, block(0.0, 7.0)), BlockVerdict::Stay);
        assert_eq!(verdict(Target::Half, block(22.0, 32.0)), BlockVerdict::Stay);
        assert_eq!(verdict(Target::Half, block(0.0, 10.0)), BlockVerdict::Stay);
    }

    #[test]
    fn hold_names_the_missing_outcomes_and_the_worst_case() {
        let block = EvidenceBlock { high: 30.0, ..full_block(23.0) };
        let hold = promotion_hold(Target::Mastery, &block).unwrap();
        assert_eq!(
            hold,
            "7 of 32 outcomes of the last block are missing: the worst case has a 10 % quantile of 0.60, 0.70 is needed"
        );
        assert!(
            promotion_hold(Target::Half, &EvidenceBlock { low: 20.0, ..block })
                .unwrap()
                .contains("mean of 0.62")
        );
        // Neither a promotion nor a block that fails even in the best case is held back.
        assert_eq!(promotion_hold(Target::Mastery, &full_block(26.0)), None);
        assert_eq!(promotion_hold(Target::Mastery, &EvidenceBlock { high: 20.0, ..full_block(10.0) }), None);
    }
}
