//! Trainers between learner and server: honest ones, careless ones, and dishonest ones. A trainer decides which results
//! the server receives; the learner's results are the same.

use env_core::KeyedRng;

use super::learner::GroupResult;

/// Number of groups of a trainer's lease.
pub(super) const LEASE_GROUPS: usize = 10;
/// Number of groups of a lease that a trainer returns without beginning them, if it does.
const RETURNED_GROUPS: usize = 3;
/// Probability that a preempted trainer stops during a lease.
const PREEMPTION_PROBABILITY: f64 = 0.3;

/// Kind of simulated trainer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TrainerKind {
    /// Reports every result as it is.
    Honest,
    /// Reports groups whose episodes all succeeded, and renews the leases of the others for ever.
    Withholds,
    /// Reports every episode that did not succeed as failed by the infrastructure.
    FailsFailures,
    /// Begins seven groups of a lease of ten, and returns the others.
    ReturnsUnbegun,
    /// Reports a lease if all audited groups succeeded, and releases it otherwise.
    ShopsAudits,
    /// Runs on machines that stop: three leases in ten end before all of their groups are rolled out.
    Preempted,
}

impl TrainerKind {
    /// All kinds of trainer.
    pub const ALL: [Self; 6] = [
        Self::Honest,
        Self::Withholds,
        Self::FailsFailures,
        Self::ReturnsUnbegun,
        Self::ShopsAudits,
        Self::Preempted,
    ];

    /// Name of the kind on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Honest => "honest",
            Self::Withholds => "withholds",
            Self::FailsFailures => "fails-failures",
            Self::ReturnsUnbegun => "returns-unbegun",
            Self::ShopsAudits => "shops-audits",
            Self::Preempted => "preempted",
        }
    }

    /// Description of the kind in a few words.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Honest => "reports every result",
            Self::Withholds => "reports groups that succeeded, and renews the leases of the others for ever",
            Self::FailsFailures => "reports every episode that did not succeed as failed",
            Self::ReturnsUnbegun => "begins seven groups of a lease of ten, and returns the others",
            Self::ShopsAudits => "releases a lease unless all of its audited groups succeeded",
            Self::Preempted => "runs on machines that stop: three leases in ten end early",
        }
    }

    /// Number of groups that the trainer begins of a lease.
    pub(super) fn begun_groups(self, leased: usize, rng: &mut KeyedRng) -> usize {
        match self {
            Self::ReturnsUnbegun => leased.saturating_sub(RETURNED_GROUPS),
            Self::Preempted if rng.bernoulli(PREEMPTION_PROBABILITY) => {
                rng.below(u32::try_from(leased).unwrap_or(u32::MAX).max(1)) as usize
            }
            _ => leased,
        }
    }

    /// True if the server gets groups back that the trainer never saw. A preempted trainer saw all of them: its client
    /// takes the scenarios with the lease.
    pub(super) const fn returns_undisclosed(self) -> bool {
        matches!(self, Self::ReturnsUnbegun)
    }

    /// Results that the server receives of a lease, in its order; `None` for a group that the trainer keeps leased.
    /// `audited` has the places of the groups that an audit would replay.
    pub(super) fn report(self, results: &[GroupResult], audited: &[usize]) -> Vec<Option<GroupResult>> {
        let all_succeeded = |result: &GroupResult| result.failed == 0 && result.successes == result.finished;
        let reported = |result: &GroupResult| match self {
            Self::Withholds => all_succeeded(result).then_some(*result),
            Self::FailsFailures => Some(GroupResult {
                finished: result.successes,
                successes: result.successes,
                failed: result.failed + result.finished - result.successes,
            }),
            Self::ShopsAudits if !audited.iter().all(|&place| all_succeeded(&results[place])) => {
                Some(GroupResult::NONE)
            }
            _ => Some(*result),
        };
        results.iter().map(reported).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: GroupResult = GroupResult { finished: 2, successes: 2, failed: 0 };
    const BAD: GroupResult = GroupResult { finished: 2, successes: 1, failed: 0 };

    #[test]
    fn dishonest_trainers_hide_groups_that_did_not_succeed() {
        let report = |kind: TrainerKind| kind.report(&[GOOD, BAD], &[0, 1]);
        assert_eq!(report(TrainerKind::Honest), [Some(GOOD), Some(BAD)]);
        assert_eq!(report(TrainerKind::Withholds), [Some(GOOD), None]);
        let failed = GroupResult { finished: 1, successes: 1, failed: 1 };
        assert_eq!(report(TrainerKind::FailsFailures), [Some(GOOD), Some(failed)]);
        assert_eq!(report(TrainerKind::ShopsAudits), [Some(GroupResult::NONE); 2]);
        assert_eq!(TrainerKind::ShopsAudits.report(&[GOOD, BAD], &[0]), [Some(GOOD), Some(BAD)]);
    }
}
