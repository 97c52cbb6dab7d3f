//! Trajectory of one satellite under a plan of burns, flown against the debris ephemeris.

use super::ephemeris::DebrisEphemeris;
use crate::kessler::constants::{EARTH_RADIUS_2, HORIZON, SURVIVAL_THRESHOLD};
use crate::kessler::kernel::{Body, ClampedBurn, clamp_burn};
use crate::kessler::setup::ContactModel;

/// Points of a trajectory: the start and every step.
pub(crate) const TRAJECTORY_POINTS: usize = HORIZON as usize + 1;

/// Burn of one satellite before the motion of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlannedBurn {
    /// Step, counted from 1.
    pub step: u32,
    /// Change of velocity along x, LU/TU.
    pub dvx: f64,
    /// Change of velocity along y, LU/TU.
    pub dvy: f64,
}

/// Loss of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TrajectoryLoss {
    /// Step, counted from 1.
    pub step: u32,
    /// True if debris hit the satellite; false if it fell into the Earth.
    pub hit: bool,
}

/// Trajectory of one satellite until it is lost or the horizon is reached. Arrays are indexed by step; 0 is
/// the start.
#[derive(Debug, Clone)]
pub(crate) struct Trajectory {
    pub bodies: [Body; TRAJECTORY_POINTS],
    pub fuel: [f64; TRAJECTORY_POINTS],
    /// Fuel that the burn of each step took.
    pub cost: [f64; TRAJECTORY_POINTS],
    /// Probability of survival under close approaches; 1 if debris destroys what it touches.
    pub survival: [f64; TRAJECTORY_POINTS],
    pub loss: Option<TrajectoryLoss>,
    /// Burns that were applied, ordered by step.
    pub burns: Vec<PlannedBurn>,
}

impl Trajectory {
    /// Creates a trajectory at its start.
    pub(crate) fn new(body: Body, fuel: f64) -> Self {
        Self {
            bodies: [body; TRAJECTORY_POINTS],
            fuel: [fuel; TRAJECTORY_POINTS],
            cost: [0.0; TRAJECTORY_POINTS],
            survival: [1.0; TRAJECTORY_POINTS],
            loss: None,
            burns: Vec::new(),
        }
    }

    /// Advances by one step under an optional burn (dvx, dvy). Returns false once the satellite is lost. A
    /// burn that the fuel does not allow is left out of the plan.
    pub(crate) fn advance(
        &mut self,
        ephemeris: &DebrisEphemeris,
        step: u32,
        burn: Option<(f64, f64)>,
    ) -> bool {
        let t = step as usize;
        let before = self.bodies[t - 1];
        let mut body = before;
        let mut fuel = self.fuel[t - 1];
        self.cost[t] = 0.0;
        if let Some((dvx, dvy)) = burn {
            let ClampedBurn { dvx, dvy, cost } = clamp_burn(dvx, dvy);
            if cost <= fuel {
                fuel -= cost;
                body.vx += dvx;
                body.vy += dvy;
                self.cost[t] = cost;
                self.burns.push(PlannedBurn { step, dvx, dvy });
            }
        }
        self.fuel[t] = fuel;
        self.survival[t] = self.survival[t - 1];
        if body.radius_squared() < EARTH_RADIUS_2 {
            self.bodies[t] = body;
            self.loss = Some(TrajectoryLoss { step, hit: false });
            return false;
        }
        body = body.coast(ephemeris.physics.gravity);
        self.bodies[t] = body;
        if let ContactModel::Probability(sigma) = ephemeris.physics.contact {
            self.survival[t] = ephemeris.survival_after(t, &before, &body, sigma, self.survival[t]);
        }
        if ephemeris.destroys(t, &body) {
            self.loss = Some(TrajectoryLoss { step, hit: true });
            return false;
        }
        true
    }

    /// Propagates the rest of the trajectory, from `step` on, under `burns` (ordered by step).
    pub(crate) fn propagate_from(&mut self, ephemeris: &DebrisEphemeris, step: u32, burns: &[PlannedBurn]) {
        self.propagate_while(ephemeris, step, burns, |_, _| true);
    }

    /// Propagates like [`Trajectory::propagate_from`] while `is_promising` is true for the trajectory and the
    /// last step. Returns true if it was propagated to its end.
    pub(crate) fn propagate_while(
        &mut self,
        ephemeris: &DebrisEphemeris,
        step: u32,
        burns: &[PlannedBurn],
        mut is_promising: impl FnMut(&Self, usize) -> bool,
    ) -> bool {
        let mut next = 0;
        for t in step..=HORIZON {
            let burn = burns.get(next).filter(|b| b.step == t).map(|b| (b.dvx, b.dvy));
            next += usize::from(burn.is_some());
            if !self.advance(ephemeris, t, burn) {
                return true;
            }
            if !is_promising(self, t as usize) {
                return false;
            }
        }
        true
    }

    /// Copies `from` up to, but not including, `step`. The caller propagates the rest.
    pub(crate) fn branch_from(&mut self, from: &Self, step: u32) {
        let t = step as usize;
        self.bodies[..t].copy_from_slice(&from.bodies[..t]);
        self.fuel[..t].copy_from_slice(&from.fuel[..t]);
        self.cost[..t].copy_from_slice(&from.cost[..t]);
        self.survival[..t].copy_from_slice(&from.survival[..t]);
        self.loss = None;
        self.burns.clear();
        self.burns.extend(from.burns.iter().filter(|b| b.step < step));
    }

    /// Number of steps that the satellite survives.
    pub(crate) fn steps_survived(&self) -> u32 {
        self.loss.map_or(HORIZON, |loss| loss.step - 1)
    }

    /// Returns true if the satellite counts as lost.
    pub(crate) fn is_lost(&self) -> bool {
        self.loss_step().is_some()
    }

    /// Step at which the satellite is lost: hit, decayed, or survival below [`SURVIVAL_THRESHOLD`].
    pub(crate) fn loss_step(&self) -> Option<u32> {
        let first_too_low =
            || (1..).zip(&self.survival[1..]).find(|(_, s)| **s < SURVIVAL_THRESHOLD).map(|(step, _)| step);
        match self.loss {
            Some(loss) => Some(loss.step),
            None if self.survival[HORIZON as usize] < SURVIVAL_THRESHOLD => first_too_low(),
            None => None,
        }
    }

    /// Steps survived, each with the probability of survival.
    pub(crate) fn survival_weights(&self) -> impl Iterator<Item = (usize, f64)> {
        (1..=self.steps_survived() as usize).map(|t| (t, self.survival[t]))
    }
}
