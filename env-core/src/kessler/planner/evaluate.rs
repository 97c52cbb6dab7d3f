//! Outcome of three trajectories together: fragments of satellites that are hit may hit the others. The
//! outcome is that of the engine to the bit; a property test checks it.

use super::ephemeris::DebrisEphemeris;
use super::trajectory::{Trajectory, TrajectoryLoss};
use crate::bracket::EpisodeOutcome;
use crate::episode_rng::SeededRng;
use crate::kessler::constants::{
    CONTACT_2, EARTH_RADIUS_2, FRAGMENTS, HORIZON, SATELLITES, SURVIVAL_THRESHOLD,
};
use crate::kessler::kernel::{Body, distance_squared, min_distance_squared};
use crate::kessler::reward::{FleetState, Objective, score};
use crate::kessler::setup::{ContactModel, KesslerSetup, Physics};
use crate::kessler::simulation::draw_fragment;
use crate::seed::Seed;

/// Outcome of three trajectories, fragments included.
pub(crate) fn plan_outcome(
    objective: Objective,
    setup: &KesslerSetup,
    seed: Seed,
    ephemeris: &DebrisEphemeris,
    trajectories: [&Trajectory; SATELLITES],
) -> EpisodeOutcome {
    let losses = losses_with_fragments(seed, ephemeris, trajectories);
    outcome_with_losses(objective, setup, trajectories, losses)
}

/// Outcome of three trajectories if each satellite is lost as `losses` says.
pub(crate) fn outcome_with_losses(
    objective: Objective,
    setup: &KesslerSetup,
    trajectories: [&Trajectory; SATELLITES],
    losses: [Option<TrajectoryLoss>; SATELLITES],
) -> EpisodeOutcome {
    let is_alive = |i: usize, step: u32| losses[i].is_none_or(|l| step < l.step);
    let mut outcome = EpisodeOutcome {
        score: 0.0,
        total_reward: 0.0,
        steps: 0,
        lost: 0,
        goal: None,
        fuel_used: 0.0,
        time_s: None,
    };
    let mut goal_sum = 0.0;
    for step in 1..=HORIZON {
        let t = step as usize;
        for (i, trajectory) in trajectories.iter().enumerate() {
            // A burn precedes the motion: a satellite that is lost in this step has still burnt.
            if is_alive(i, step - 1) && trajectory.cost[t] > 0.0 {
                outcome.fuel_used += trajectory.cost[t];
            }
        }
        let fleet =
            FleetState {
                bodies: trajectories.map(|trajectory| trajectory.bodies[t]),
                fuel: trajectories.map(|trajectory| trajectory.fuel[t]),
                survival: std::array::from_fn(|i| {
                    if is_alive(i, step) { trajectories[i].survival[t] } else { 0.0 }
                }),
            };
        let goal = objective.goal(&fleet);
        if step > HORIZON - objective.goal_steps() {
            goal_sum += goal;
        }
        outcome.total_reward += objective.reward(&fleet, setup.fuel, goal);
        outcome.steps = step;
        if (0..SATELLITES).all(|i| !is_alive(i, step)) {
            break;
        }
    }
    let end = outcome.steps as usize;
    let is_lost = |i: &usize| losses[*i].is_some() || trajectories[*i].survival[end] < SURVIVAL_THRESHOLD;
    outcome.lost = (0..SATELLITES).filter(is_lost).count() as u32;
    outcome.score = score(outcome.total_reward);
    let steps = objective.goal_steps();
    outcome.goal = (steps > 0).then(|| goal_sum / f64::from(steps));
    outcome
}

/// Loss of each satellite, including hits by fragments of the others.
pub(crate) fn losses_with_fragments(
    seed: Seed,
    ephemeris: &DebrisEphemeris,
    trajectories: [&Trajectory; SATELLITES],
) -> [Option<TrajectoryLoss>; SATELLITES] {
    let mut losses = trajectories.map(|trajectory| trajectory.loss);
    if losses.iter().flatten().all(|l| !l.hit) {
        return losses;
    }
    let mut rng = SeededRng::new(seed);
    let mut done = [false; SATELLITES];
    loop {
        let next = (0..SATELLITES)
            .filter(|&i| !done[i])
            .filter_map(|i| losses[i].filter(|l| l.hit).map(|l| (l.step, i)))
            .min();
        let Some((step, i)) = next else { return losses };
        done[i] = true;
        for _ in 0..FRAGMENTS {
            let fragment = draw_fragment(trajectories[i].bodies[step as usize], &mut rng);
            propagate_fragment(fragment, step, i, ephemeris.physics, trajectories, &mut losses);
        }
    }
}

/// Propagates a fragment of satellite `source`, which was hit in `first_step`, and records the satellites
/// that it hits.
fn propagate_fragment(
    mut fragment: Body,
    first_step: u32,
    source: usize,
    physics: Physics,
    trajectories: [&Trajectory; SATELLITES],
    losses: &mut [Option<TrajectoryLoss>; SATELLITES],
) {
    for step in first_step..=HORIZON {
        if step > first_step {
            if fragment.radius_squared() < EARTH_RADIUS_2 {
                if !physics.upstream_compat {
                    return;
                }
            } else {
                fragment = fragment.coast(physics.gravity);
            }
        }
        for (i, trajectory) in trajectories.iter().enumerate() {
            // In the step of the collision the engine checks only the satellites after the one that was hit.
            let is_checked =
                i != source && (step > first_step || i > source) && losses[i].is_none_or(|l| step < l.step);
            let body = trajectory.bodies[step as usize];
            let d2 = || {
                if physics.contact == ContactModel::Swept && step > first_step {
                    let (dx, dy) = (body.x - fragment.x, body.y - fragment.y);
                    min_distance_squared(dx, dy, body.vx - fragment.vx, body.vy - fragment.vy)
                } else {
                    distance_squared(body.x, body.y, fragment.x, fragment.y)
                }
            };
            if is_checked && d2() < CONTACT_2 {
                losses[i] = Some(TrajectoryLoss { step, hit: true });
            }
        }
    }
}
