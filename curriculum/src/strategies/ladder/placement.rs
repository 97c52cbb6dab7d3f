//! Placement: bisection over a task's levels for the level at which a new run starts.

use serde::{Deserialize, Serialize};

use crate::core::evidence::block::{DiscardedBlocks, EvidenceBlock};
use crate::core::evidence::level_move::{MoveEvidence, ProbeSummary};
use crate::core::outcome::GroupOutcome;

/// Number of contested scenarios in a probe.
pub(super) const PROBE_SIZE: u32 = 16;
/// Mean success rate from which a probed level passes.
pub(super) const PASS_MEAN: f64 = 0.5;

/// Bisection in progress. Success is assumed to fall with the level: every level below a passed one counts as passed,
/// every level above a failed one as failed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Placement {
    /// Lowest level that is not known to pass.
    unknown: u32,
    /// Lowest level that is known to fail, or the number of levels.
    failed: u32,
    /// Probe that is in progress.
    pub(super) filling: EvidenceBlock,
    /// Probes that counted, in order.
    pub(super) probes: Vec<ProbeSummary>,
    /// Probes that were repeated because they lost too many episodes.
    pub(super) discarded: DiscardedBlocks,
}

/// Effect of an outcome on a placement.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum PlacementStep {
    /// The probe continues at its level.
    SameLevel,
    /// The next probe is at another level.
    NextLevel,
    /// The placement ends; the task starts at this level.
    Placed(u32),
}

impl Placement {
    /// A placement over the levels 0 to `hardest_level`.
    pub(super) fn new(hardest_level: u32) -> Self {
        Self {
            unknown: 0,
            failed: hardest_level + 1,
            filling: EvidenceBlock::default(),
            probes: Vec::new(),
            discarded: DiscardedBlocks::default(),
        }
    }

    /// Level being probed: halfway between the highest passed level (−1 if none has passed) and the lowest failed one.
    pub(super) const fn level(&self) -> u32 {
        (self.unknown + self.failed).saturating_sub(1) / 2
    }

    /// True if a restored placement is consistent with a level table up to `hardest_level`.
    pub(super) const fn fits(&self, hardest_level: u32) -> bool {
        self.unknown < self.failed && self.failed <= hardest_level + 1
    }

    /// Records a contested outcome of the level being probed.
    pub(super) fn observe(&mut self, outcome: &GroupOutcome) -> PlacementStep {
        let Some(full) = self.filling.record_until_full(outcome, PROBE_SIZE, &mut self.discarded) else {
            return PlacementStep::SameLevel;
        };
        let (level, mean) = (self.level(), full.mean());
        let passed = mean >= PASS_MEAN;
        self.probes.push(ProbeSummary { level, n: full.n, sum: full.sum, mean, passed, first: full.first });
        self.discarded = DiscardedBlocks::default();
        if passed {
            self.unknown = level + 1;
        } else {
            self.failed = level;
        }
        if self.unknown < self.failed {
            PlacementStep::NextLevel
        } else {
            PlacementStep::Placed(self.unknown.saturating_sub(1))
        }
    }

    /// Seq of the earliest proposal behind the probes; `None` before the first outcome.
    pub(super) fn earliest_proposal(&self) -> Option<u64> {
        let counted = self.probes.iter().map(|probe| probe.first.unwrap_or(0));
        counted.chain(self.filling.earliest_proposal()).min()
    }

    /// Evidence of the move to `level` that ends the placement.
    pub(super) fn evidence(&self, level: u32) -> MoveEvidence {
        let probes = self.probes.iter().map(|probe| {
            let result = if probe.passed { "passed" } else { "failed" };
            format!("level {} {result} with {:.2} of {}", probe.level, probe.sum, probe.n)
        });
        let probes = probes.collect::<Vec<_>>().join(", ");
        let chosen = if self.unknown == 0 { "no level passed" } else { "the highest that passed" };
        MoveEvidence {
            sentence: format!("placed at level {level}, {chosen}: {probes} (at least {PASS_MEAN} passes)"),
            blocks: Vec::new(),
            probes: self.probes.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::outcome;

    /// Level that a placement finds, and the levels it probed.
    struct Placed {
        level: u32,
        probed: Vec<u32>,
    }

    /// Places an agent that passes every level up to `highest_passing`.
    fn place(hardest_level: u32, highest_passing: Option<u32>) -> Placed {
        let mut placement = Placement::new(hardest_level);
        loop {
            let level = placement.level();
            let passes = highest_passing.is_some_and(|highest| level <= highest);
            match placement.observe(&outcome("t", Some(level), 1, u32::from(passes))) {
                PlacementStep::Placed(level) => {
                    return Placed { level, probed: placement.probes.iter().map(|p| p.level).collect() };
                }
                PlacementStep::SameLevel | PlacementStep::NextLevel => assert!(placement.fits(hardest_level)),
            }
        }
    }

    #[test]
    fn four_probes_find_the_highest_passing_of_ten_levels() {
        for highest in 0..10 {
            let placed = place(9, Some(highest));
            assert_eq!(placed.level, highest, "{:?}", placed.probed);
            assert!(placed.probed.len() <= 4, "{:?}", placed.probed);
        }
        let none_passes = place(9, None);
        assert_eq!((none_passes.level, none_passes.probed), (0, vec![4, 1, 0]));
    }

    #[test]
    fn placement_works_on_tables_of_any_length() {
        for hardest_level in 0..100 {
            assert_eq!(place(hardest_level, None).level, 0);
            for highest in 0..=hardest_level {
                assert_eq!(place(hardest_level, Some(highest)).level, highest);
            }
        }
    }

    #[test]
    fn probe_with_too_many_lost_episodes_is_repeated() {
        let mut placement = Placement::new(9);
        let lost = GroupOutcome { finished: 0, failed: 1, ..outcome("t", Some(4), 1, 0) };
        placement.observe(&lost);
        placement.observe(&lost);
        for _ in 0..PROBE_SIZE {
            assert_eq!(placement.observe(&outcome("t", Some(4), 1, 1)), PlacementStep::SameLevel);
        }
        assert_eq!((placement.level(), placement.discarded.count, placement.filling.n), (4, 1, 0));
        for _ in 1..PROBE_SIZE {
            assert_eq!(placement.observe(&outcome("t", Some(4), 1, 1)), PlacementStep::SameLevel);
        }
        assert_eq!(placement.observe(&outcome("t", Some(4), 1, 1)), PlacementStep::NextLevel);
        assert_eq!(placement.level(), 7);
    }
}
