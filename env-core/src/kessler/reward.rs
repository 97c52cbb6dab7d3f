//! Objectives, rewards and scores of the tasks.

use super::constants::{
    EPSILON, FORMATION_SIDE, FORMATION_STEPS, FORMATION_WIDTH, HORIZON, PROXIMITY_WIDTH, RENDEZVOUS_STEPS,
    SATELLITES, TARGET_RADIUS,
};
use super::kernel::{Body, distance_squared};

/// Objective of a kessler task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Objective {
    /// Keep all satellites alive.
    Survival,
    /// Keep all satellites alive and their fuel unspent.
    EcoStation,
    /// Keep all satellites alive and bring satellite 0 to radius 100 LU.
    Rendezvous,
    /// Keep all satellites alive in an equilateral triangle of side 20 LU.
    Formation,
}

impl Objective {
    /// All objectives, in the order of the tasks.
    pub(super) const ALL: [Self; 4] = [Self::Survival, Self::EcoStation, Self::Rendezvous, Self::Formation];

    /// Id of the task with this objective.
    pub(super) const fn task_id(self) -> &'static str {
        match self {
            Self::Survival => "kessler/survival",
            Self::EcoStation => "kessler/eco_station",
            Self::Rendezvous => "kessler/rendezvous",
            Self::Formation => "kessler/formation",
        }
    }

    /// The objective of a task, or `None` if the id is not one of kessler's.
    pub(super) fn of_task(id: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|objective| objective.task_id() == id)
    }
}

/// Proximity of a radius to the rendezvous target: max(0, 1 − |r − 100|/30).
#[must_use]
#[inline]
pub fn proximity(radius: f64) -> f64 {
    (1.0 - (radius - TARGET_RADIUS).abs() / PROXIMITY_WIDTH).max(0.0)
}

/// Quality of the formation triangle: the mean over the three pairs of max(0, 1 − |d − 20|/20).
#[must_use]
#[inline]
pub fn formation_quality(satellites: &[Body; SATELLITES]) -> f64 {
    let pair = |i: usize, j: usize| {
        let (a, b) = (&satellites[i], &satellites[j]);
        let distance = distance_squared(a.x, a.y, b.x, b.y).sqrt();
        (1.0 - (distance - FORMATION_SIDE).abs() / FORMATION_WIDTH).max(0.0)
    };
    (pair(0, 1) + pair(0, 2) + pair(1, 2)) / 3.0
}

/// State of the satellites that a reward depends on.
#[derive(Debug, Clone, Copy)]
pub struct FleetState {
    /// Positions and velocities of the satellites.
    pub bodies: [Body; SATELLITES],
    /// Remaining fuel of each satellite.
    pub fuel: [f64; SATELLITES],
    /// Probability that each satellite still flies: 1 or 0, or under `risk: pc` any value between.
    pub survival: [f64; SATELLITES],
}

impl Objective {
    /// Number of last steps over which the goal is averaged; 0 if the task has no goal.
    #[must_use]
    pub const fn goal_steps(self) -> u32 {
        match self {
            Self::Survival | Self::EcoStation => 0,
            Self::Rendezvous => RENDEZVOUS_STEPS,
            Self::Formation => FORMATION_STEPS,
        }
    }

    /// How close the goal is, 0 to 1: proximity of satellite 0, or formation quality; 0 if the task has no
    /// goal.
    #[must_use]
    #[inline]
    pub fn goal(self, fleet: &FleetState) -> f64 {
        match self {
            Self::Survival | Self::EcoStation => 0.0,
            Self::Rendezvous if fleet.survival[0] > 0.0 => {
                proximity(fleet.bodies[0].radius()) * fleet.survival[0]
            }
            Self::Formation if fleet.survival.iter().all(|&survival| survival > 0.0) => {
                formation_quality(&fleet.bodies) * fleet.survival.iter().product::<f64>()
            }
            Self::Rendezvous | Self::Formation => 0.0,
        }
    }

    /// Team reward of one step. `initial_fuel` is the fuel of one satellite at the start; `goal` is the value
    /// of [`Objective::goal`].
    #[must_use]
    #[inline]
    pub fn reward(self, fleet: &FleetState, initial_fuel: f64, goal: f64) -> f64 {
        let full_reward = (1.0 - 2.0 * EPSILON) / f64::from(HORIZON);
        let active: f64 = fleet.survival.iter().sum();
        let base = active / SATELLITES as f64 * full_reward;
        match self {
            Self::Survival => base,
            Self::EcoStation => {
                let fuel: f64 =
                    fleet.fuel.iter().zip(fleet.survival).map(|(fuel, survival)| fuel * survival).sum();
                base * (fuel / (SATELLITES as f64 * initial_fuel))
            }
            Self::Rendezvous | Self::Formation => 0.5 * base + 0.5 * goal * full_reward,
        }
    }
}

/// Score of a sum of rewards, clamped to [ε, 1 − ε].
#[must_use]
pub fn score(total: f64) -> f64 {
    total.clamp(EPSILON, 1.0 - EPSILON)
}
