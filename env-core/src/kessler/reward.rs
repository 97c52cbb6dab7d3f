//! Rewards and scores of kessler, to the number.

use super::constants::{EPSILON, HORIZON, PROXIMITY_WIDTH, SATELLITES, TARGET_RADIUS};

/// What a kessler task rewards.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Objective {
    /// Keep all satellites.
    Survival,
    /// Keep all satellites and their fuel.
    EcoStation,
    /// Keep all satellites and bring satellite 0 to radius 100 LU.
    Rendezvous,
}

/// max(0, 1 − |r − 100|/30).
#[must_use]
pub fn proximity(radius: f64) -> f64 {
    (1.0 - (radius - TARGET_RADIUS).abs() / PROXIMITY_WIDTH).max(0.0)
}

impl Objective {
    /// The team's reward for one step.
    ///
    /// `fuel` is the sum over active satellites and `initial_fuel` that of one satellite at the start; `proximity` is
    /// that of satellite 0, zero once it is lost.
    #[must_use]
    pub fn reward(self, active: usize, fuel: f64, initial_fuel: f64, proximity: f64) -> f64 {
        let full = (1.0 - 2.0 * EPSILON) / f64::from(HORIZON);
        let b = active as f64 / SATELLITES as f64 * full;
        match self {
            Self::Survival => b,
            Self::EcoStation => b * (fuel / (SATELLITES as f64 * initial_fuel)),
            Self::Rendezvous => 0.5 * b + 0.5 * proximity * full,
        }
    }
}

/// The score of a sum of rewards: clamped inside (0, 1).
#[must_use]
pub fn score(total: f64) -> f64 {
    total.clamp(EPSILON, 1.0 - EPSILON)
}
