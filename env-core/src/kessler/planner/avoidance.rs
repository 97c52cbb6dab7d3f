//! Avoidance: short burn schedules for one satellite that would be lost under hold.

use std::f64::consts::TAU;

use super::ephemeris::DebrisEphemeris;
use super::panel::affordable_size;
use super::trajectory::{PlannedBurn, Trajectory};
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::constants::{CONTACT_2, FUEL_PER_SPEED, HORIZON, SURVIVAL_THRESHOLD};
use crate::kessler::kernel::{ClampedBurn, clamp_burn};
use crate::kessler::reward::Objective;
use crate::kessler::setup::ContactModel;

/// Sizes of the single burns tried, LU/TU, gentlest first.
const SINGLE_BURN_SIZES: [f64; 5] = [0.05, 0.1, 0.2, 0.4, 0.8];
/// Number of directions of the single burns tried.
const SINGLE_BURN_DIRECTIONS: u32 = 16;
/// Number of random schedules tried if no single burn helps.
const SCHEDULES: u32 = 3000;
/// Number of burns of a random schedule.
const SCHEDULE_BURNS: usize = 4;
/// The worth and its bound are sums of 50 terms in the same order; rounding separates them by less than 50 ε.
const ROUNDING_MARGIN: f64 = 1.0 + 1e-12;

/// Search for the best trajectory of one satellite.
struct AvoidanceSearch<'a> {
    objective: Objective,
    ephemeris: &'a DebrisEphemeris,
    hold: &'a Trajectory,
    best: Trajectory,
    best_worth: f64,
    is_wanted: &'a dyn Fn() -> bool,
}

/// Returns the best trajectory found for a satellite, given its panel (hold first). The search ends early
/// once `is_wanted` returns false.
pub(super) fn search(
    objective: Objective,
    ephemeris: &DebrisEphemeris,
    panel: &[Trajectory],
    rng: &mut SeededRng,
    is_wanted: &dyn Fn() -> bool,
) -> Trajectory {
    let hold = &panel[0];
    if !hold.is_lost() {
        return hold.clone();
    }
    ephemeris.prepare_search();
    let (best, best_worth) = (hold.clone(), worth(objective, hold));
    let mut search = AvoidanceSearch { objective, ephemeris, hold, best, best_worth, is_wanted };
    search.try_panel(panel);
    if !search.best.is_lost() && objective != Objective::EcoStation {
        return search.best;
    }
    search.try_single_burns();
    if search.best.is_lost() {
        search.try_schedules(rng);
    }
    search.best
}

/// Contribution of one trajectory to the team's reward. Apart from fragments, the reward is the sum over
/// satellites.
fn worth(objective: Objective, trajectory: &Trajectory) -> f64 {
    match objective {
        Objective::EcoStation => {
            trajectory.survival_weights().map(|(t, weight)| trajectory.fuel[t] * weight).sum()
        }
        Objective::Survival | Objective::Rendezvous | Objective::Formation => {
            trajectory.survival_weights().map(|(_, weight)| weight).sum()
        }
    }
}

impl AvoidanceSearch<'_> {
    /// Tries the plans of the panel. Kicks grow in size, so the first that survives is the gentlest.
    fn try_panel(&mut self, panel: &[Trajectory]) {
        for trajectory in panel {
            if !trajectory.is_lost() {
                let value = worth(self.objective, trajectory);
                self.keep_if_better(trajectory, value);
            }
        }
    }

    /// Tries one burn: sizes from small to large, steps from late to early, 16 directions.
    fn try_single_burns(&mut self) {
        let Some(loss_step) = self.hold.loss_step() else { return };
        let fuel = self.hold.fuel[0];
        let last = loss_step as usize;
        let is_end_of_step_hit = self.ephemeris.physics.contact == ContactModel::EndOfStep
            && self.hold.loss.is_some_and(|loss| loss.hit);
        let threat =
            is_end_of_step_hit.then(|| self.ephemeris.first_hit(last, &self.hold.bodies[last])).flatten();
        let mut trajectory = self.hold.clone();
        for size in SINGLE_BURN_SIZES {
            let size = affordable_size(size, fuel);
            for step in (1..=loss_step).rev() {
                if !(self.is_wanted)() {
                    return;
                }
                if single_burn_bound(self.objective, fuel, size, step) <= self.best_worth {
                    break; // An earlier burn of this size is worth less still.
                }
                for direction in 0..SINGLE_BURN_DIRECTIONS {
                    let angle = TAU * f64::from(direction) / f64::from(SINGLE_BURN_DIRECTIONS);
                    let (sin, cos) = libm::sincos(angle);
                    let burn = PlannedBurn { step, dvx: size * cos, dvy: size * sin };
                    if threat.is_some_and(|column| !self.clears(burn, column, loss_step)) {
                        continue;
                    }
                    if self.try_burns(&mut trajectory, &[burn]) {
                        return;
                    }
                }
            }
        }
    }

    /// Tries random schedules of four burns.
    fn try_schedules(&mut self, rng: &mut SeededRng) {
        let Some(loss_step) = self.hold.loss_step() else { return };
        let fuel = self.hold.fuel[0];
        let mut trajectory = self.hold.clone();
        for _ in 0..SCHEDULES {
            if !(self.is_wanted)() {
                return;
            }
            let mut burns = [PlannedBurn { step: 1, dvx: 0.0, dvy: 0.0 }; SCHEDULE_BURNS];
            for (i, burn) in burns.iter_mut().enumerate() {
                // The first burn acts before the contact; the others at any step.
                let window = if i == 0 { loss_step } else { HORIZON };
                burn.step = 1 + (rng.uniform(RngStream::Planner) * f64::from(window)) as u32;
                let max_size = affordable_size(1.0, fuel / SCHEDULE_BURNS as f64 * 2.0);
                let size = max_size * rng.uniform(RngStream::Planner);
                let (sin, cos) = libm::sincos(TAU * rng.uniform(RngStream::Planner));
                (burn.dvx, burn.dvy) = (size * cos, size * sin);
            }
            burns.sort_by_key(|b| b.step);
            if self.try_burns(&mut trajectory, &burns) {
                return;
            }
        }
    }

    /// Propagates `trajectory` under `burns` and keeps it if it is better. Returns true if the satellite
    /// survives.
    fn try_burns(&mut self, trajectory: &mut Trajectory, burns: &[PlannedBurn]) -> bool {
        let step = burns.first().map_or(1, |burn| burn.step);
        trajectory.branch_from(self.hold, step);
        let Some(value) = self.propagate_if_promising(trajectory, step, burns) else { return false };
        self.keep_if_better(trajectory, value);
        !trajectory.is_lost()
    }

    /// Propagates `trajectory` and returns its worth, or `None` if it can neither survive nor be the best.
    fn propagate_if_promising(
        &self,
        trajectory: &mut Trajectory,
        step: u32,
        burns: &[PlannedBurn],
    ) -> Option<f64> {
        let complete = if matches!(self.ephemeris.physics.contact, ContactModel::Probability(_)) {
            let mut bound = WorthBound::new(self.objective, trajectory, step, self.best_worth);
            trajectory.propagate_while(self.ephemeris, step, burns, |trajectory, t| {
                bound.is_promising(trajectory, t)
            })
        } else {
            trajectory.propagate_from(self.ephemeris, step, burns);
            true
        };
        complete.then(|| worth(self.objective, trajectory))
    }

    fn keep_if_better(&mut self, trajectory: &Trajectory, value: f64) {
        if value > self.best_worth {
            self.best_worth = value;
            self.best.clone_from(trajectory);
        }
    }

    /// Returns true if the burn clears the debris that hits under hold, up to the step of that contact.
    fn clears(&self, burn: PlannedBurn, column: usize, until: u32) -> bool {
        let mut body = self.hold.bodies[burn.step as usize - 1];
        let ClampedBurn { dvx, dvy, .. } = clamp_burn(burn.dvx, burn.dvy);
        body.vx += dvx;
        body.vy += dvy;
        for step in burn.step..=until {
            body = body.coast(self.ephemeris.physics.gravity);
            let d2 = self.ephemeris.distance_squared_to(column, step as usize, body.x, body.y);
            if d2 < CONTACT_2 {
                return false;
            }
        }
        true
    }
}

/// Worth of a trajectory that survives with one burn of `size` at `step`.
fn single_burn_bound(objective: Objective, fuel: f64, size: f64, step: u32) -> f64 {
    match objective {
        Objective::Survival | Objective::Rendezvous | Objective::Formation => f64::from(HORIZON),
        Objective::EcoStation => {
            fuel * f64::from(HORIZON) - FUEL_PER_SPEED * size * f64::from(HORIZON + 1 - step)
        }
    }
}

/// Upper bound of the worth of a trajectory in progress under `risk: pc`, where survival and fuel only fall.
struct WorthBound {
    objective: Objective,
    /// Worth that the trajectory must exceed.
    best_worth: f64,
    /// Worth of the steps so far.
    so_far: f64,
}

impl WorthBound {
    /// Bound of a trajectory that is propagated from `step` on.
    fn new(objective: Objective, trajectory: &Trajectory, step: u32, best_worth: f64) -> Self {
        let so_far = (1..step as usize).map(|t| Self::step_worth(objective, trajectory, t)).sum();
        Self { objective, best_worth, so_far }
    }

    fn step_worth(objective: Objective, trajectory: &Trajectory, t: usize) -> f64 {
        match objective {
            Objective::EcoStation => trajectory.fuel[t] * trajectory.survival[t],
            Objective::Survival | Objective::Rendezvous | Objective::Formation => trajectory.survival[t],
        }
    }

    /// Returns true if the trajectory may still count as alive at the end, or be worth more than the best.
    /// Otherwise the search would discard it whatever it does from here.
    fn is_promising(&mut self, trajectory: &Trajectory, t: usize) -> bool {
        let now = Self::step_worth(self.objective, trajectory, t);
        self.so_far += now;
        let rest = now * (HORIZON as usize - t) as f64;
        trajectory.survival[t] >= SURVIVAL_THRESHOLD
            || (self.so_far + rest) * ROUNDING_MARGIN > self.best_worth
    }
}
