//! Rewards and scores of kessler, to the number.

use super::constants::{
    EPSILON, FORMATION_SIDE, FORMATION_STEPS, FORMATION_WIDTH, HORIZON, PROXIMITY_WIDTH, RENDEZVOUS_STEPS,
    SATELLITES, TARGET_RADIUS,
};
use super::kernel::{Body, distance_2};

/// What a kessler task rewards.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Objective {
    /// Keep all satellites.
    Survival,
    /// Keep all satellites and their fuel.
    EcoStation,
    /// Keep all satellites and bring satellite 0 to radius 100 LU.
    Rendezvous,
    /// Keep all satellites in an equilateral triangle of side 20 LU.
    Formation,
}

/// max(0, 1 − |r − 100|/30).
#[must_use]
#[inline]
pub fn proximity(radius: f64) -> f64 {
    (1.0 - (radius - TARGET_RADIUS).abs() / PROXIMITY_WIDTH).max(0.0)
}

/// Mean over the three pairs of max(0, 1 − |d − 20|/20).
#[must_use]
#[inline]
pub fn form(satellites: &[Body; SATELLITES]) -> f64 {
    let pair = |i: usize, j: usize| {
        let (a, b) = (&satellites[i], &satellites[j]);
        let distance = distance_2(a.x, a.y, b.x, b.y).sqrt();
        (1.0 - (distance - FORMATION_SIDE).abs() / FORMATION_WIDTH).max(0.0)
    };
    (pair(0, 1) + pair(0, 2) + pair(1, 2)) / 3.0
}

/// Where the satellites are and how likely each still flies: 1 or 0, or under `risk: pc` anything between.
#[derive(Debug, Clone, Copy)]
pub struct Fleet {
    /// Places.
    pub bodies: [Body; SATELLITES],
    /// Fuel left.
    pub fuel: [f64; SATELLITES],
    /// Weights.
    pub alive: [f64; SATELLITES],
}

impl Objective {
    /// Steps at the end over which the goal is judged; 0 where there is none.
    #[must_use]
    pub const fn goal_steps(self) -> u32 {
        match self {
            Self::Survival | Self::EcoStation => 0,
            Self::Rendezvous => RENDEZVOUS_STEPS,
            Self::Formation => FORMATION_STEPS,
        }
    }

    /// How near the goal is: proximity of satellite 0, or form; zero where there is none.
    #[must_use]
    #[inline]
    pub fn goal(self, fleet: &Fleet) -> f64 {
        match self {
            Self::Survival | Self::EcoStation => 0.0,
            Self::Rendezvous if fleet.alive[0] > 0.0 => proximity(fleet.bodies[0].radius()) * fleet.alive[0],
            Self::Formation if fleet.alive.iter().all(|&alive| alive > 0.0) => {
                form(&fleet.bodies) * fleet.alive.iter().product::<f64>()
            }
            Self::Rendezvous | Self::Formation => 0.0,
        }
    }

    /// The team's reward for one step; `initial_fuel` is that of one satellite at the start, `goal` that of
    /// [`Objective::goal`].
    #[must_use]
    #[inline]
    pub fn reward(self, fleet: &Fleet, initial_fuel: f64, goal: f64) -> f64 {
        let full = (1.0 - 2.0 * EPSILON) / f64::from(HORIZON);
        let active: f64 = fleet.alive.iter().sum();
        let b = active / SATELLITES as f64 * full;
        match self {
            Self::Survival => b,
            Self::EcoStation => {
                let fuel: f64 = fleet.fuel.iter().zip(fleet.alive).map(|(fuel, alive)| fuel * alive).sum();
                b * (fuel / (SATELLITES as f64 * initial_fuel))
            }
            Self::Rendezvous | Self::Formation => 0.5 * b + 0.5 * goal * full,
        }
    }
}

/// The score of a sum of rewards: clamped inside (0, 1).
#[must_use]
pub fn score(total: f64) -> f64 {
    total.clamp(EPSILON, 1.0 - EPSILON)
}
