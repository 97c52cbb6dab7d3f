//! One deputy and its step of one second: thrust, motion, end conditions, reward.
//!
//! It covers everything except collisions. Simulation, planner and critique all use it, so they follow one rule.

use super::constants::{DOCKING_RADIUS_M, FAILURE_REWARD, MAX_DISTANCE_M, MIN_VELOCITY_PENALTY, STEP_S};
use super::end_conditions::EndConditions;
use super::relative_motion::{RelativeState, StepTransition, distance, speed, speed_limit};
use super::reward::{
    DockingReward, approach_reward, delta_v_reward, docking_reward, proximity, speed_limit_reward,
    thrust_delta_v,
};
use super::setup::DockingSetup;

/// State of one deputy.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Deputy {
    /// Position in m and velocity in m/s.
    pub state: RelativeState,
    /// Proximity to the chief after the last step, see [`proximity`].
    pub proximity: f64,
    /// Sum of its velocity rewards.
    pub velocity_penalty: f64,
    /// Sum of its rewards.
    pub total_reward: f64,
    /// Rules by which it left; none while it is active.
    pub end_conditions: EndConditions,
}

/// Result of a step of one deputy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeputyStep {
    /// Reward of the deputy by component.
    pub reward: DockingReward,
    /// Change of velocity by the thrust, summed over the axes, m/s.
    pub delta_v: f64,
}

impl Deputy {
    /// Creates a deputy at its start.
    #[must_use]
    pub fn new(state: RelativeState) -> Self {
        Self { state, ..Self::default() }
    }

    /// True if it has not left the episode.
    #[inline]
    #[must_use]
    pub const fn is_active(&self) -> bool {
        !self.end_conditions.any()
    }

    /// Advances the deputy by step `step`, counted from 1, under a thrust in N that is clamped per axis.
    #[inline]
    pub fn step(
        &mut self,
        transition: &StepTransition,
        setup: &DockingSetup,
        step: u32,
        thrust: [f64; 3],
    ) -> DeputyStep {
        let bound = setup.thrust_bound;
        let thrust = thrust.map(|axis| axis.clamp(-bound, bound));
        self.state = transition.advance(&self.state, thrust);
        let (d, v) = (distance(&self.state), speed(&self.state));
        let limit = speed_limit(d);
        let near = proximity(d);
        let change = thrust_delta_v(thrust);
        let mut reward = DockingReward {
            distance: if step == 1 { 0.0 } else { approach_reward(self.proximity, near) },
            delta_v: delta_v_reward(change),
            velocity: speed_limit_reward(v, limit),
            ..DockingReward::default()
        };
        self.proximity = near;
        self.velocity_penalty += reward.velocity;
        let inside = d <= DOCKING_RADIUS_M;
        self.end_conditions = EndConditions {
            timeout: step >= setup.time_limit,
            out_of_bounds: d > MAX_DISTANCE_M,
            crash: inside && v > limit,
            docked: inside && v <= limit,
            saturated: self.velocity_penalty <= MIN_VELOCITY_PENALTY,
            collision: false,
        };
        if self.end_conditions.docked {
            reward.success = docking_reward(f64::from(step) * STEP_S, f64::from(setup.time_limit) * STEP_S);
        }
        if self.end_conditions.timeout || self.end_conditions.out_of_bounds || self.end_conditions.crash {
            reward.failure = FAILURE_REWARD;
        }
        self.total_reward += reward.total();
        DeputyStep { reward, delta_v: change }
    }
}
