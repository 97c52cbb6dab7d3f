//! Rewards of one deputy in one step, by component.

use serde::{Deserialize, Serialize};

use super::constants::{
    DELTA_V_COST, DISTANCE_DECAY_1_M, DISTANCE_SCALE, MASS_KG, SUCCESS_REWARD, VIOLATION_COST,
};

/// The components of a deputy's reward, in the order in which they are added.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct DockingReward {
    /// Reward for approaching the chief; zero on the first step.
    pub distance: f64,
    /// Reward for the change of velocity by thrust, not positive.
    pub delta_v: f64,
    /// Reward for violating the speed limit, not positive.
    pub velocity: f64,
    /// Reward for docking, with the bonus for docking early.
    pub success: f64,
    /// Reward for a timeout, leaving bounds or a crash, not positive.
    pub failure: f64,
}

impl DockingReward {
    /// Sum of the components.
    #[inline]
    #[must_use]
    pub fn total(&self) -> f64 {
        self.distance + self.delta_v + self.velocity + self.success + self.failure
    }
}

/// Proximity to the chief: 1 at the chief, halved every 100 m.
#[inline]
#[must_use]
pub fn proximity(distance: f64) -> f64 {
    libm::exp(-DISTANCE_DECAY_1_M * distance)
}

/// Reward for approaching the chief, from the proximity before and after a step.
#[inline]
#[must_use]
pub fn approach_reward(before: f64, after: f64) -> f64 {
    DISTANCE_SCALE * (after - before)
}

/// Change of velocity by a thrust of one second, m/s. The axes are summed, since each has its own thrusters.
#[inline]
#[must_use]
pub fn thrust_delta_v(thrust: [f64; 3]) -> f64 {
    (thrust[0].abs() + thrust[1].abs() + thrust[2].abs()) / MASS_KG
}

/// Reward for a change of velocity.
#[inline]
#[must_use]
pub fn delta_v_reward(delta_v: f64) -> f64 {
    0.0 - DELTA_V_COST * delta_v // no thrust gives 0, not −0
}

/// Reward for exceeding the speed limit; zero below it.
#[inline]
#[must_use]
pub fn speed_limit_reward(speed: f64, limit: f64) -> f64 {
    if speed > limit { -VIOLATION_COST * (speed - limit) - VIOLATION_COST } else { 0.0 }
}

/// Reward for docking at a time; time and time limit in s.
#[inline]
#[must_use]
pub fn docking_reward(time: f64, limit: f64) -> f64 {
    SUCCESS_REWARD + SUCCESS_REWARD * (1.0 - time / limit)
}
