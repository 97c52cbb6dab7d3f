//! Verdicts on a deputy's thrusts.
//!
//! An episode has hundreds of seconds of thrust, and one second of it changes little. So the critique judges arcs: the
//! trajectory of each deputy is divided into at most six windows of equal length, 30 s or more, the last with the
//! remainder. The thrust in a window is one arc, and its counterfactual is the same trajectory without it.

use super::trajectory::DockingTrajectory;
use crate::critique::{ActionVerdict, Verdict};
use crate::docking::constants::{COLLISION_DISTANCE_M, FAILURE_REWARD, STATE_DIM, STEP_S};
use crate::docking::end_conditions::DeputyStatus;
use crate::docking::relative_motion::{RelativeState, StepTransition, Transition, distance, separation};
use crate::docking::reward::{approach_reward, proximity, thrust_delta_v};

/// Largest number of windows of a trajectory.
const MAX_WINDOWS: u32 = 6;
/// Length of the shortest window, steps.
const MIN_WINDOW_STEPS: u32 = 30;
/// Duration of a counterfactual after the deputy left in the episode, s.
const COAST_STEPS: u32 = 60;
/// Smallest relevant difference of a deputy's return.
const MIN_RELEVANT_GAIN: f64 = 0.05;

/// Judges each arc, in order of step.
pub(super) fn judge_arcs(trajectory: &DockingTrajectory) -> Vec<ActionVerdict> {
    let mut verdicts = Vec::new();
    for deputy in 0..trajectory.deputy_count() {
        let left = trajectory.last_step(deputy);
        let length = left.div_ceil(MAX_WINDOWS).max(MIN_WINDOW_STEPS);
        let mut from = 1;
        while from <= left {
            let to = (from + length - 1).min(left);
            let mut cost = 0.0;
            let mut first = None;
            for step in from..=to {
                let change = thrust_delta_v(trajectory.thrust(deputy, step));
                if change > 0.0 {
                    first = first.or(Some(step));
                    cost += change;
                }
            }
            if let Some(step) = first {
                verdicts.push(judge_arc(trajectory, deputy, step, to, cost));
            }
            from = to + 1;
        }
    }
    verdicts.sort_by_key(|verdict| (verdict.step, verdict.agent));
    verdicts
}

fn judge_arc(trajectory: &DockingTrajectory, deputy: usize, from: u32, to: u32, cost: f64) -> ActionVerdict {
    let with = trajectory.deputy(deputy, trajectory.last_step(deputy)).total_reward;
    let status = trajectory.sim.status(deputy);
    let (without, status_without) = simulate_without(trajectory, deputy, from, to);
    let gain = with - without;
    let verdict = match (status == DeputyStatus::Docked, status_without == DeputyStatus::Docked) {
        (true, false) => Verdict::Needed,
        (false, true) => Verdict::Harmful,
        _ if status == DeputyStatus::Collided && status_without != DeputyStatus::Collided => Verdict::Harmful,
        _ if gain >= MIN_RELEVANT_GAIN => Verdict::Needed,
        _ if gain <= -MIN_RELEVANT_GAIN => Verdict::Harmful,
        _ if gain < 0.0 => Verdict::Wasteful,
        _ => Verdict::Harmless,
    };
    ActionVerdict {
        step: from,
        agent: deputy as u32,
        cost,
        verdict,
        // The score is the mean of the returns. Only this deputy's return is compared: what the others would have done
        // without a collision is unknown.
        gain: gain / trajectory.deputy_count() as f64,
    }
}

/// Return and status of the deputy without its thrust in these steps, with the others as recorded.
///
/// If it is still active when it left in the episode, it coasts: first for a minute by the rules of the world, then until the
/// time limit or the collision of two others. For the latter part only its final position counts; collisions are ignored.
fn simulate_without(
    trajectory: &DockingTrajectory,
    deputy: usize,
    from: u32,
    to: u32,
) -> (f64, DeputyStatus) {
    let setup = trajectory.sim.setup();
    // A collision of two others ends the episode whatever this deputy does.
    let others_collide = trajectory
        .collided_pairs()
        .any(|pair| pair.0 != deputy && pair.1 != deputy)
        .then(|| trajectory.sim.steps());
    // Its own collision ended the episode for the others too, so their later states are unknown.
    let collided = trajectory.sim.status(deputy) == DeputyStatus::Collided;
    let end = others_collide.unwrap_or(setup.time_limit);
    let last = end.min(trajectory.last_step(deputy) + if collided { 0 } else { COAST_STEPS });
    let mut counterfactual = *trajectory.deputy(deputy, from - 1);
    for step in from..=last {
        let thrust = if step <= to { [0.0; 3] } else { trajectory.thrust(deputy, step) };
        counterfactual.step(StepTransition::world_step(), setup, step, thrust);
        if counterfactual.is_active()
            && (others_collide == Some(step) || collides(trajectory, deputy, step, &counterfactual.state))
        {
            counterfactual.end_conditions.collision = true;
        }
        if !counterfactual.is_active() {
            return (counterfactual.total_reward, counterfactual.end_conditions.status());
        }
    }
    if collided {
        return (counterfactual.total_reward, DeputyStatus::Active);
    }
    let drifted = Transition::over(f64::from(end - last) * STEP_S).phi
        * nalgebra::SVector::<f64, STATE_DIM>::from(counterfactual.state);
    let total_reward = counterfactual.total_reward
        + approach_reward(counterfactual.proximity, proximity(distance(&drifted.into())));
    match others_collide {
        Some(_) => (total_reward, DeputyStatus::Collided),
        None => (total_reward + FAILURE_REWARD, DeputyStatus::TimedOut),
    }
}

/// True if the deputy would collide at this step with another that is still active.
fn collides(trajectory: &DockingTrajectory, deputy: usize, step: u32, state: &RelativeState) -> bool {
    (0..trajectory.deputy_count()).any(|other| {
        let is_active = trajectory.last_step(other) > step
            || (trajectory.last_step(other) == step
                && trajectory.sim.status(other) == DeputyStatus::Collided);
        other != deputy
            && is_active
            && separation(state, trajectory.state(other, step)) < COLLISION_DISTANCE_M
    })
}
