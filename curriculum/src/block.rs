//! Blocks: what a move of the ladder rests on.
//!
//! One contested scenario is one observation. A rule that looks at a sliding window after every observation is a
//! sequential test without a correction and promotes nearly everybody in time (optional stopping: Armitage, McPherson
//! and Rowe 1969). So observations are gathered into disjoint blocks, and the rule looks only when one is full.

use serde::{Deserialize, Serialize};

use super::event::{BlockEvidence, GroupOutcome};
use super::posterior::Posterior;
use super::settings::Target;

/// Scenarios in a block.
pub(super) const BLOCK: u32 = 32;
/// Mastered: the 10 % quantile of a block reaches this (26 of 32).
pub(super) const MASTERED: f64 = 0.70;
/// Out of reach: the 90 % quantile of a block is at most this (6 of 32).
pub(super) const OUT_OF_REACH: f64 = 0.30;
/// `target: half`: up above this mean.
pub(super) const HALF_UP: f64 = 0.7;
/// `target: half`: down below this mean.
pub(super) const HALF_DOWN: f64 = 0.3;
/// Share of a block's episodes that may be lost. Above, the block does not count: a trainer that loses what it would
/// have failed must not look good.
const MAX_LOST: f64 = 0.10;

/// Observations gathered so far, and the episodes behind them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Tally {
    /// Scenarios with a value.
    pub(super) n: u32,
    /// Sum of their values.
    pub(super) sum: f64,
    /// Episodes that finished.
    pub(super) finished: u32,
    /// Episodes that failed or expired, those of scenarios without a value included.
    pub(super) lost: u32,
    /// The seq of the earliest proposal in it; none in one of before that was noted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) first: Option<u64>,
}

impl Tally {
    /// Takes a contested outcome. A group that was lost as a whole is no observation, but its episodes are lost ones.
    pub(super) fn take(&mut self, outcome: &GroupOutcome) {
        self.finished = self.finished.saturating_add(outcome.finished);
        self.lost = self.lost.saturating_add(outcome.lost());
        if self.n == 0 || self.first.is_some() {
            self.first = Some(self.first.map_or(outcome.proposal, |first| first.min(outcome.proposal)));
        }
        if let Some(value) = outcome.value() {
            self.n += 1;
            self.sum += value;
        }
    }

    /// Whether too many episodes were lost for this to count.
    pub(super) fn lossy(&self) -> bool {
        f64::from(self.lost) > MAX_LOST * (f64::from(self.finished) + f64::from(self.lost))
    }

    /// The seq of the earliest proposal that it can rest on; none while it is empty.
    pub(super) fn rests_on(&self) -> Option<u64> {
        let begun = self.n > 0 || self.lost > 0;
        begun.then(|| self.first.unwrap_or(0))
    }

    pub(super) fn mean(&self) -> f64 {
        if self.n == 0 { 0.0 } else { self.sum / f64::from(self.n) }
    }

    const fn posterior(&self) -> Posterior {
        Posterior { n: self.n, sum: self.sum }
    }

    pub(super) fn q10(&self) -> f64 {
        self.posterior().quantile(0.10)
    }

    pub(super) fn q90(&self) -> f64 {
        self.posterior().quantile(0.90)
    }

    fn mastered(&self) -> bool {
        self.q10() >= MASTERED
    }

    fn out_of_reach(&self) -> bool {
        self.q90() <= OUT_OF_REACH
    }

    pub(super) fn evidence(&self) -> BlockEvidence {
        BlockEvidence {
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

/// What a full block asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Up,
    Down,
    Stay,
}

/// What a full block and the one before it, since the last move, ask for.
pub(super) fn verdict(target: Target, before: Option<&Tally>, full: &Tally) -> Verdict {
    match target {
        Target::Half if full.mean() > HALF_UP => Verdict::Up,
        Target::Half if full.mean() < HALF_DOWN => Verdict::Down,
        Target::Half => Verdict::Stay,
        Target::Mastery => match before {
            Some(before) if before.mastered() && full.mastered() => Verdict::Up,
            Some(before) if before.out_of_reach() && full.out_of_reach() => Verdict::Down,
            _ => Verdict::Stay,
        },
    }
}

/// Lost episodes from which a block still filling is worth a warning.
const LOST_WORTH_A_WARNING: u32 = 8;

/// What the status says of lost episodes: of the tallies discarded for them, and of the one that fills.
pub(super) fn loss_warnings(noun: &str, of: &str, discarded: &Discarded, filling: &Tally) -> Vec<String> {
    let mut warnings = Vec::new();
    if discarded.count > 0 {
        let (plural, were) = if discarded.count == 1 { ("", "was") } else { ("s", "were") };
        warnings.push(format!(
            "{} {noun}{plural}{of} {were} discarded, because more than 10 % of the episodes failed or expired \
             ({} of {} the last time); nothing moves on such evidence",
            discarded.count,
            discarded.lost,
            u64::from(discarded.lost) + u64::from(discarded.finished),
        ));
    }
    if filling.lost >= LOST_WORTH_A_WARNING && filling.lossy() {
        warnings.push(format!(
            "{} of the {} episodes of the evidence now gathering failed or expired; above 10 % it will not count",
            filling.lost,
            u64::from(filling.lost) + u64::from(filling.finished),
        ));
    }
    warnings
}

/// Full tallies that did not count since the last move, and the episodes of the latest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Discarded {
    pub(super) count: u32,
    finished: u32,
    lost: u32,
}

impl Discarded {
    pub(super) fn add(&mut self, tally: &Tally) {
        *self = Self { count: self.count.saturating_add(1), finished: tally.finished, lost: tally.lost };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(sum: f64) -> Tally {
        Tally { n: BLOCK, sum, finished: BLOCK, lost: 0, first: Some(0) }
    }

    #[test]
    fn twenty_six_of_thirty_two_is_mastered_and_twenty_five_is_not() {
        assert!(of(26.0).mastered(), "{}", of(26.0).q10());
        assert!(!of(25.0).mastered(), "{}", of(25.0).q10());
        assert!(of(6.0).out_of_reach(), "{}", of(6.0).q90());
        assert!(!of(7.0).out_of_reach(), "{}", of(7.0).q90());
    }

    #[test]
    fn mastery_needs_two_blocks_running() {
        let verdict = |before: Option<f64>, full: f64| {
            super::verdict(Target::Mastery, before.map(of).as_ref(), &of(full))
        };
        assert_eq!(verdict(None, 32.0), Verdict::Stay);
        assert_eq!(verdict(Some(26.0), 26.0), Verdict::Up);
        assert_eq!(verdict(Some(25.0), 32.0), Verdict::Stay);
        assert_eq!(verdict(Some(32.0), 25.0), Verdict::Stay);
        assert_eq!(verdict(Some(6.0), 6.0), Verdict::Down);
        assert_eq!(verdict(Some(7.0), 0.0), Verdict::Stay);
        assert_eq!(verdict(Some(32.0), 0.0), Verdict::Stay);
        assert_eq!(verdict(None, 0.0), Verdict::Stay);
    }

    #[test]
    fn half_needs_one_block_and_both_bounds_are_strict() {
        let verdict = |sum: f64| super::verdict(Target::Half, None, &of(sum));
        assert_eq!(verdict(22.5), Verdict::Up);
        assert_eq!(verdict(22.375), Verdict::Stay); // 0.699
        assert_eq!(verdict(16.0), Verdict::Stay);
        assert_eq!(verdict(9.625), Verdict::Stay); // 0.301
        assert_eq!(verdict(9.5), Verdict::Down);
    }

    #[test]
    fn a_tenth_may_be_lost_and_no_more() {
        assert!(!Tally { finished: 90, lost: 10, ..Tally::default() }.lossy());
        assert!(Tally { finished: 89, lost: 10, ..Tally::default() }.lossy());
        assert!(!Tally::default().lossy());
    }
}
