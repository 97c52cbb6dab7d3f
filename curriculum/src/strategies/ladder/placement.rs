//! Placement: bisection over a task's levels for the level at which a new run starts.

use serde::{Deserialize, Serialize};

use crate::core::evidence::block::{EvidenceBlock, format_count};
use crate::core::evidence::level_move::{MoveEvidence, ProbeSummary};
use crate::core::evidence::slot_queue::SlotQueue;

/// Number of contested scenarios in a probe.
pub(super) const PROBE_SIZE: u32 = 16;
/// Mean success rate from which a probed level passes, missing episodes counted as failures.
pub(super) const PASS_MEAN: f64 = 0.5;

/// Bisection in progress. Success is assumed to fall with the level: every level below a passed one counts as passed,
/// every level above a failed one as failed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Placement {
    /// Lowest level that is not known to pass.
    unknown: u32,
    /// Lowest level that is known to fail, or the number of levels.
    failed: u32,
    /// Slots of the probe that are not settled.
    pub(super) queue: SlotQueue,
    /// Probe that is in progress.
    pub(super) filling: EvidenceBlock,
    /// Probes that ended, in order.
    pub(super) probes: Vec<ProbeSummary>,
}

/// Effect of settled slots on a placement.
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
            queue: SlotQueue::default(),
            filling: EvidenceBlock::default(),
            probes: Vec::new(),
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

    /// Moves settled slots into the probe, until it is full.
    pub(super) fn settle(&mut self) -> PlacementStep {
        while let Some(settled) = self.queue.next_settled() {
            if let Some(full) = self.filling.record_until_full(settled, PROBE_SIZE) {
                return self.end_probe(full);
            }
        }
        PlacementStep::SameLevel
    }

    /// Judges a full probe. Slots that were opened beyond it are of a level that is not probed any more.
    fn end_probe(&mut self, full: EvidenceBlock) -> PlacementStep {
        let (level, mean) = (self.level(), full.mean_low());
        let passed = mean >= PASS_MEAN;
        let EvidenceBlock { n, low, high, first } = full;
        self.probes.push(ProbeSummary { level, n, low, high, mean, passed, first });
        self.queue = SlotQueue::default();
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

    /// Seq of the earliest proposal behind the probes; `None` before the first slot.
    pub(super) fn earliest_proposal(&self) -> Option<u64> {
        let counted = self.probes.iter().map(|probe| probe.first.unwrap_or(0));
        counted.chain(self.filling.first).chain(self.queue.earliest_proposal()).min()
    }

    /// Evidence of the move to `level` that ends the placement.
    pub(super) fn evidence(&self, level: u32) -> MoveEvidence {
        let probes = self.probes.iter().map(|probe| {
            let result = if probe.passed { "passed" } else { "failed" };
            format!("level {} {result} with {} of {}", probe.level, format_count(probe.low), probe.n)
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
    use crate::core::evidence::interval::SuccessInterval;
    use crate::core::outcome::GroupOutcome;
    use crate::tests::{outcome, slot_of};

    /// Level that a placement finds, and the levels it probed.
    struct Placed {
        level: u32,
        probed: Vec<u32>,
    }

    /// Opens a slot with the value, and settles it.
    fn observe(placement: &mut Placement, proposal: u64, value: SuccessInterval) -> PlacementStep {
        let slot = slot_of(&GroupOutcome { proposal, ..outcome("t", Some(placement.level()), 1, 1) });
        placement.queue.open(&slot);
        placement.queue.resolve(slot.key(), value);
        placement.settle()
    }

    /// Places an agent that passes every level up to `highest_passing`.
    fn place(hardest_level: u32, highest_passing: Option<u32>) -> Placed {
        let mut placement = Placement::new(hardest_level);
        for proposal in 0.. {
            let success = highest_passing.is_some_and(|highest| placement.level() <= highest);
            let success = f64::from(u8::from(success));
            match observe(&mut placement, proposal, SuccessInterval { low: success, high: success }) {
                PlacementStep::Placed(level) => {
                    return Placed { level, probed: placement.probes.iter().map(|p| p.level).collect() };
                }
                PlacementStep::SameLevel | PlacementStep::NextLevel => assert!(placement.fits(hardest_level)),
            }
        }
        unreachable!("a placement ends")
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
    fn missing_outcomes_count_as_failures_of_a_probe() {
        let success = SuccessInterval { low: 1.0, high: 1.0 };
        let probe_with = |missing: u64| {
            let mut placement = Placement::new(9);
            for proposal in 0..u64::from(PROBE_SIZE) {
                let value = if proposal < missing { SuccessInterval::MISSING } else { success };
                observe(&mut placement, proposal, value);
            }
            placement.level()
        };
        assert_eq!((probe_with(8), probe_with(9)), (7, 1));
    }
}
