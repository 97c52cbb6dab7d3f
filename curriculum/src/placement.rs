//! Where a new run starts on a task: bisection over its levels.

use serde::{Deserialize, Serialize};

use super::block::{Discarded, Tally};
use super::event::{Evidence, GroupOutcome, ProbeEvidence};

/// Contested scenarios of a probe.
pub(super) const PROBE: u32 = 16;
/// Mean at which a probed level passes.
pub(super) const PASS: f64 = 0.5;

/// A bisection under way. Success is taken to fall with the level: every level below a passed one is held passed,
/// every level above a failed one failed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Placement {
    /// Lowest level not known to pass.
    unknown: u32,
    /// Lowest level known to fail, or the number of levels.
    failed: u32,
    /// The probe under way.
    pub(super) filling: Tally,
    /// Probes that decided.
    pub(super) probes: Vec<ProbeEvidence>,
    /// Probes begun again, because too many episodes were lost.
    pub(super) discarded: Discarded,
}

/// What an outcome did to a placement.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Step {
    /// The probe goes on.
    Same,
    /// Another level is probed.
    Next,
    /// It is over: start here.
    Placed(u32),
}

impl Placement {
    /// A placement over levels 0 to `top`.
    pub(super) fn new(top: u32) -> Self {
        Self {
            unknown: 0,
            failed: top + 1,
            filling: Tally::default(),
            probes: Vec::new(),
            discarded: Discarded::default(),
        }
    }

    /// The level probed now: halfway between the highest passed (−1 where none is) and the lowest failed.
    pub(super) const fn level(&self) -> u32 {
        (self.unknown + self.failed).saturating_sub(1) / 2
    }

    /// Whether a stored state can be one of a table up to `top`.
    pub(super) const fn fits(&self, top: u32) -> bool {
        self.unknown < self.failed && self.failed <= top + 1
    }

    /// Takes a contested outcome of the level probed now.
    pub(super) fn take(&mut self, outcome: &GroupOutcome) -> Step {
        self.filling.take(outcome);
        if self.filling.n < PROBE {
            return Step::Same;
        }
        let full = std::mem::take(&mut self.filling);
        if full.lossy() {
            self.discarded.add(&full);
            return Step::Same;
        }
        let (level, passed) = (self.level(), full.mean() >= PASS);
        let (mean, first) = (full.mean(), full.first);
        self.probes.push(ProbeEvidence { level, n: full.n, sum: full.sum, mean, passed, first });
        self.discarded = Discarded::default();
        if passed {
            self.unknown = level + 1;
        } else {
            self.failed = level;
        }
        if self.unknown < self.failed { Step::Next } else { Step::Placed(self.unknown.saturating_sub(1)) }
    }

    /// The seq of the earliest proposal that it rests on so far.
    pub(super) fn rests_on(&self) -> Option<u64> {
        let decided = self.probes.iter().map(|probe| probe.first.unwrap_or(0));
        decided.chain(self.filling.rests_on()).min()
    }

    /// What the placement rests on.
    pub(super) fn evidence(&self, to: u32) -> Evidence {
        let probes = self.probes.iter().map(|probe| {
            let word = if probe.passed { "passed" } else { "failed" };
            format!("level {} {word} with {:.2} of {}", probe.level, probe.sum, probe.n)
        });
        let probes = probes.collect::<Vec<_>>().join(", ");
        let chosen = if self.unknown == 0 { "no level passed" } else { "the highest that passed" };
        Evidence {
            sentence: format!("placed at level {to}, {chosen}: {probes} (at least {PASS} passes)"),
            blocks: Vec::new(),
            probes: self.probes.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::outcome;

    fn place(top: u32, highest: Option<u32>) -> (u32, Vec<u32>) {
        let mut placement = Placement::new(top);
        loop {
            let level = placement.level();
            let passes = highest.is_some_and(|highest| level <= highest);
            match placement.take(&outcome("t", Some(level), 1, u32::from(passes))) {
                Step::Placed(at) => return (at, placement.probes.iter().map(|p| p.level).collect()),
                Step::Same | Step::Next => assert!(placement.fits(top)),
            }
        }
    }

    #[test]
    fn finds_the_highest_level_that_passes_in_four_probes_of_ten() {
        for highest in 0..10 {
            let (at, probes) = place(9, Some(highest));
            assert_eq!(at, highest, "{probes:?}");
            assert!(probes.len() <= 4, "{probes:?}");
        }
        assert_eq!(place(9, None), (0, vec![4, 1, 0]));
    }

    #[test]
    fn works_on_tables_of_any_length() {
        for top in 0..100 {
            assert_eq!(place(top, None).0, 0);
            for highest in 0..=top {
                assert_eq!(place(top, Some(highest)).0, highest);
            }
        }
    }

    #[test]
    fn a_probe_with_too_many_lost_episodes_starts_over() {
        let mut placement = Placement::new(9);
        let lost = GroupOutcome { finished: 0, failed: 1, ..outcome("t", Some(4), 1, 0) };
        placement.take(&lost);
        placement.take(&lost);
        for _ in 0..PROBE {
            assert_eq!(placement.take(&outcome("t", Some(4), 1, 1)), Step::Same);
        }
        assert_eq!((placement.level(), placement.discarded.count, placement.filling.n), (4, 1, 0));
        for _ in 1..PROBE {
            assert_eq!(placement.take(&outcome("t", Some(4), 1, 1)), Step::Same);
        }
        assert_eq!(placement.take(&outcome("t", Some(4), 1, 1)), Step::Next);
        assert_eq!(placement.level(), 7);
    }
}
