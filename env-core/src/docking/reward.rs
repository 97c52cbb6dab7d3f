//! Rewards of one deputy in one step, by component.

use serde::{Deserialize, Serialize};

use super::constants::{DELTA_V_COST, DISTANCE_DECAY_1_M, DISTANCE_SCALE, MASS_KG, SUCCESS, VIOLATION_COST};

/// The components of a deputy's reward, in the order in which they are added.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Reward {
    /// For coming nearer; zero on the first step.
    pub distance: f64,
    /// For the change of velocity that the thrust makes.
    pub delta_v: f64,
    /// For violating the speed limit.
    pub velocity: f64,
    /// For docking.
    pub success: f64,
    /// For a timeout, leaving bounds or a crash.
    pub failure: f64,
}

impl Reward {
    /// Their sum.
    #[inline]
    #[must_use]
    pub fn total(&self) -> f64 {
        self.distance + self.delta_v + self.velocity + self.success + self.failure
    }
}

/// How near a deputy is, from 0 far away to 1 at the chief: halved every 100 m.
#[inline]
#[must_use]
pub fn nearness(distance: f64) -> f64 {
    libm::exp(-DISTANCE_DECAY_1_M * distance)
}

/// For coming nearer, from nearness before and after.
#[inline]
#[must_use]
pub fn approach(before: f64, after: f64) -> f64 {
    DISTANCE_SCALE * (after - before)
}

/// What a thrust of one second changes the velocity by, m/s, axes added up: each axis has thrusters of its own.
#[inline]
#[must_use]
pub fn delta_v(thrust: [f64; 3]) -> f64 {
    (thrust[0].abs() + thrust[1].abs() + thrust[2].abs()) / MASS_KG
}

/// For that change.
#[inline]
#[must_use]
pub fn thrusting(delta_v: f64) -> f64 {
    0.0 - DELTA_V_COST * delta_v // nothing is 0, not −0
}

/// For speed beyond the limit; zero within it.
#[inline]
#[must_use]
pub fn violation(speed: f64, limit: f64) -> f64 {
    if speed > limit { -VIOLATION_COST * (speed - limit) - VIOLATION_COST } else { 0.0 }
}

/// For docking at a time, of a time limit, both s.
#[inline]
#[must_use]
pub fn docking(time: f64, limit: f64) -> f64 {
    SUCCESS + SUCCESS * (1.0 - time / limit)
}
