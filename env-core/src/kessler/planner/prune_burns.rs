//! Pruning of burns that gain nothing. Under `risk: pc` every close approach costs a little survival, so
//! almost any burn changes the score a little. A change below the tolerance is no reason to burn: the
//! reference holds wherever holding is as good.

use super::ephemeris::DebrisEphemeris;
use super::trajectory::{PlannedBurn, Trajectory};
use crate::bracket::EpisodeOutcome;
use crate::kessler::constants::{EPSILON, GOAL_THRESHOLD, SATELLITES};

/// Plan after pruning, and its outcome.
pub(super) struct PrunedPlan {
    pub trajectories: [Trajectory; SATELLITES],
    pub outcome: EpisodeOutcome,
}

/// Removes the burns of `trajectories` that gain nothing: first it replaces whole satellites by hold, then it
/// removes single burns, the last first. All removals together cost less than ε of the score (the tolerance
/// of the critique), lose no satellite, and fail no goal that was met. `evaluate` computes the outcome of a
/// plan; `outcome` is that of `trajectories`.
pub(super) fn prune_burns(
    ephemeris: &DebrisEphemeris,
    holds: [&Trajectory; SATELLITES],
    trajectories: [&Trajectory; SATELLITES],
    outcome: EpisodeOutcome,
    evaluate: impl Fn([&Trajectory; SATELLITES]) -> EpisodeOutcome,
) -> PrunedPlan {
    let mut plan = PrunedPlan { trajectories: trajectories.map(Trajectory::clone), outcome };
    let replace_if_as_good = |plan: &mut PrunedPlan, satellite: usize, other: &Trajectory| {
        let candidate = std::array::from_fn(|i| if i == satellite { other } else { &plan.trajectories[i] });
        let candidate_outcome = evaluate(candidate);
        if is_as_good(&candidate_outcome, &outcome) {
            plan.outcome = candidate_outcome;
            plan.trajectories[satellite].clone_from(other);
        }
    };
    for (satellite, hold) in holds.into_iter().enumerate() {
        if !plan.trajectories[satellite].burns.is_empty() {
            replace_if_as_good(&mut plan, satellite, hold);
        }
    }
    let mut candidate = holds[0].clone();
    for satellite in 0..SATELLITES {
        for index in (0..plan.trajectories[satellite].burns.len()).rev() {
            let mut burns: Vec<PlannedBurn> = plan.trajectories[satellite].burns.clone();
            let step = burns.remove(index).step;
            candidate.branch_from(&plan.trajectories[satellite], step);
            candidate.propagate_from(ephemeris, step, &burns[index..]);
            replace_if_as_good(&mut plan, satellite, &candidate);
        }
    }
    plan
}

fn is_as_good(candidate: &EpisodeOutcome, original: &EpisodeOutcome) -> bool {
    let meets_goal = |outcome: &EpisodeOutcome| outcome.goal.is_none_or(|goal| goal >= GOAL_THRESHOLD);
    candidate.score > original.score - EPSILON
        && candidate.lost <= original.lost
        && (meets_goal(candidate) || !meets_goal(original))
}
