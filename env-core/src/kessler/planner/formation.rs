//! Formation keeping. The control law is deadbeat (a burn moves the next position directly, since `p += v`
//! comes last): it propagates the three satellites without a burn, fits the nearest triangle of the right
//! side to the result, and burns in proportion to the deviation. Only the shape is controlled; the position
//! and orientation of the triangle are left free, which costs least. The planner searches the few gains of
//! the law, the look-ahead for debris, and evasive burns for satellites that are lost all the same.

use super::coasting_courses::CoastingCourses;
use super::ephemeris::DebrisEphemeris;
use super::evaluate::plan_outcome;
use super::look_ahead::LookAhead;
use super::panel::PANEL_SIZE;
use super::trajectory::Trajectory;
use super::transfer::affordable_burn;
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::constants::{FORMATION_SIDE, GOAL_THRESHOLD, HORIZON, SATELLITES};
use crate::kessler::kernel::{Body, Gravity};
use crate::kessler::reward::{FleetState, Objective, score};
use crate::kessler::setup::KesslerSetup;
use crate::seed::Seed;

/// Gains of the formation control law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::kessler) struct FormationGains {
    /// Steps that are forecast; the deviation at their end is corrected in equal parts.
    pub ahead: u32,
    /// Share of the deviation that is corrected.
    pub gain: f64,
    /// Deviation below which a satellite does not burn, LU.
    pub tolerance: f64,
    /// Last step of formation keeping.
    pub until: u32,
}

impl FormationGains {
    /// Gains of the causal policies: they hold a triangle well with any fuel that allows it.
    pub(in crate::kessler) const DEFAULT: Self = Self { ahead: 2, gain: 0.6, tolerance: 0.5, until: HORIZON };
}

/// Number of trials with random gains.
const RANDOM_GAIN_TRIALS: u32 = 70;
/// Number of trials with gains near the best.
const LOCAL_GAIN_TRIALS: u32 = 50;
/// Number of evasive maneuvers tried if a satellite is lost.
const EVASION_TRIALS: u32 = 220;
/// Allowance for the rounding of a score that is summed up in another order.
const ROUNDING: f64 = 1e-9;
/// Longest time that an evasive maneuver suspends formation keeping, steps.
const MAX_EVASION_STEPS: f64 = 8.0;

/// Burns (dvx, dvy) of the three satellites that restore the triangle, LU/TU.
pub(in crate::kessler) fn formation_burns(
    bodies: &[Body; SATELLITES],
    gains: &FormationGains,
    gravity: Gravity,
) -> [(f64, f64); SATELLITES] {
    let mut forecast = *bodies;
    for _ in 0..gains.ahead {
        forecast = forecast.map(|body| body.coast(gravity));
    }
    let part = gains.gain / f64::from(gains.ahead.max(1));
    triangle_deviations(&forecast).map(|(x, y)| {
        if x * x + y * y < gains.tolerance * gains.tolerance { (0.0, 0.0) } else { (part * x, part * y) }
    })
}

/// Vector from each position to its corner of the nearest equilateral triangle of the right side, in the
/// least-squares sense. The centre of the triangle is the centroid; its rotation solves the orthogonal
/// Procrustes problem in the plane (Schönemann 1966).
fn triangle_deviations(positions: &[Body; SATELLITES]) -> [(f64, f64); SATELLITES] {
    const HALF_ROOT_3: f64 = 0.866_025_403_784_438_6;
    /// Corners of the triangle on the unit circle.
    const CORNERS: [(f64, f64); SATELLITES] = [(1.0, 0.0), (-0.5, HALF_ROOT_3), (-0.5, -HALF_ROOT_3)];
    let circumradius = FORMATION_SIDE / (2.0 * HALF_ROOT_3);
    let third = 1.0 / SATELLITES as f64;
    let cx = (positions[0].x + positions[1].x + positions[2].x) * third;
    let cy = (positions[0].y + positions[1].y + positions[2].y) * third;
    let (mut along, mut across) = (0.0, 0.0);
    for (position, (ox, oy)) in positions.iter().zip(CORNERS) {
        let (x, y) = (position.x - cx, position.y - cy);
        along += ox * x + oy * y;
        across += ox * y - oy * x;
    }
    let size = (along * along + across * across).sqrt().max(f64::MIN_POSITIVE);
    let (cos, sin) = (along / size, across / size);
    std::array::from_fn(|i| {
        let (ox, oy) = CORNERS[i];
        let (x, y) = (circumradius * (cos * ox - sin * oy), circumradius * (sin * ox + cos * oy));
        (cx + x - positions[i].x, cy + y - positions[i].y)
    })
}

/// Evasive maneuver: one satellite burns and then leaves the formation for some steps.
#[derive(Debug, Clone, Copy)]
struct EvasiveManeuver {
    satellite: usize,
    step: u32,
    /// Step from which the satellite keeps the formation again.
    until: u32,
    dv: (f64, f64),
}

/// Loss of a satellite in the best plan so far.
#[derive(Debug, Clone, Copy)]
struct PlanLoss {
    satellite: usize,
    step: u32,
}

/// Random search over gains, look-ahead and evasive maneuvers.
struct FormationSearch<'a> {
    setup: &'a KesslerSetup,
    seed: Seed,
    ephemeris: &'a DebrisEphemeris,
    holds: [&'a Trajectory; SATELLITES],
    best: [Trajectory; SATELLITES],
    best_worth: f64,
    trial: [Trajectory; SATELLITES],
    /// Courses of the trial.
    courses: CoastingCourses,
    /// Plan of the best gains and look-ahead, without an evasive maneuver.
    without_maneuver: [Trajectory; SATELLITES],
}

/// Returns the best trajectories found. `avoidance` are those that avoidance alone gives. The search ends
/// early once `is_wanted` returns false.
pub(super) fn search(
    setup: &KesslerSetup,
    seed: Seed,
    ephemeris: &DebrisEphemeris,
    panels: &[Vec<Trajectory>; SATELLITES],
    avoidance: [Trajectory; SATELLITES],
    rng: &mut SeededRng,
    is_wanted: &dyn Fn() -> bool,
) -> [Trajectory; SATELLITES] {
    debug_assert_eq!(panels[0].len(), PANEL_SIZE);
    ephemeris.prepare_search();
    let holds = [&panels[0][0], &panels[1][0], &panels[2][0]];
    let trial = holds.map(Trajectory::clone);
    let without_maneuver = trial.clone();
    let mut search = FormationSearch {
        setup,
        seed,
        ephemeris,
        holds,
        best: avoidance,
        best_worth: 0.0,
        courses: CoastingCourses::new(trial[0].bodies[0]),
        trial,
        without_maneuver,
    };
    search.best_worth = search.worth_of(&search.best);
    let mut best_gains = FormationGains::DEFAULT;
    let mut best_look_ahead = LookAhead::DEFAULT;
    search.propagate_trial(&best_gains, &best_look_ahead, None, f64::NEG_INFINITY);
    search.keep_if_better();
    for trial in 0..RANDOM_GAIN_TRIALS + LOCAL_GAIN_TRIALS {
        if !is_wanted() {
            return search.best;
        }
        let gains = if trial < RANDOM_GAIN_TRIALS { draw_gains(rng) } else { perturb_gains(best_gains, rng) };
        let look_ahead = draw_look_ahead(rng);
        if search.propagate_trial(&gains, &look_ahead, None, search.best_worth) && search.keep_if_better() {
            (best_gains, best_look_ahead) = (gains, look_ahead);
        }
    }
    search.propagate_trial(&best_gains, &best_look_ahead, None, f64::NEG_INFINITY);
    search.without_maneuver.clone_from(&search.trial);
    for _ in 0..EVASION_TRIALS {
        let Some(loss) = search.draw_loss(rng).filter(|_| is_wanted()) else { break };
        let maneuver = draw_maneuver(loss, rng);
        if search.propagate_trial(&best_gains, &best_look_ahead, Some(maneuver), search.best_worth) {
            search.keep_if_better();
        }
    }
    search.best
}

fn draw_gains(rng: &mut SeededRng) -> FormationGains {
    let mut draw = |low: f64, high: f64| rng.uniform_in(RngStream::Planner, low, high);
    FormationGains {
        ahead: draw(1.0, 7.0) as u32,
        gain: draw(0.1, 1.0),
        tolerance: draw(0.0, 4.0) * draw(0.0, 1.0),
        until: if draw(0.0, 1.0) < 0.6 { HORIZON } else { draw(20.0, 50.0) as u32 },
    }
}

/// Draws a look-ahead. With hindsight it can pay to look farther, and to act sooner or later.
fn draw_look_ahead(rng: &mut SeededRng) -> LookAhead {
    let mut draw = |low: f64, high: f64| rng.uniform_in(RngStream::Planner, low, high);
    let act_within = draw(2.0, 14.0) as u32;
    LookAhead { steps: act_within + draw(2.0, 10.0) as u32, act_within, margin: draw(1.0, 2.0) }
}

fn perturb_gains(gains: FormationGains, rng: &mut SeededRng) -> FormationGains {
    let mut draw = |spread: f64| rng.uniform_in(RngStream::Planner, -spread, spread);
    FormationGains {
        ahead: (f64::from(gains.ahead) + draw(1.5)).clamp(1.0, 8.0) as u32,
        gain: (gains.gain + draw(0.2)).clamp(0.05, 1.0),
        tolerance: (gains.tolerance + draw(0.7)).max(0.0),
        until: (f64::from(gains.until) + draw(6.0)).clamp(10.0, f64::from(HORIZON)) as u32,
    }
}

/// Draws an evasive maneuver of the satellite that is lost, a few steps before the loss.
fn draw_maneuver(loss: PlanLoss, rng: &mut SeededRng) -> EvasiveManeuver {
    let PlanLoss { satellite, step: lost } = loss;
    let mut draw = |low: f64, high: f64| rng.uniform_in(RngStream::Planner, low, high);
    let step = (f64::from(lost) - draw(0.0, 6.0)).max(1.0) as u32;
    let size = draw(0.1, 1.0);
    let (sin, cos) = libm::sincos(draw(0.0, std::f64::consts::TAU));
    let until = lost.max(step) + 1 + draw(0.0, MAX_EVASION_STEPS) as u32;
    EvasiveManeuver { satellite, step, until, dv: (size * cos, size * sin) }
}

impl FormationSearch<'_> {
    /// Propagates the control law with collision avoidance and an optional evasive maneuver into `trial`. Returns false if
    /// it ended early, because the plan cannot be worth more than `best_worth`.
    fn propagate_trial(
        &mut self,
        gains: &FormationGains,
        look_ahead: &LookAhead,
        maneuver: Option<EvasiveManeuver>,
        best_worth: f64,
    ) -> bool {
        // Up to the maneuver the trial is the plan without one.
        let first = maneuver.map_or(1, |maneuver| maneuver.step);
        for (i, trajectory) in self.trial.iter_mut().enumerate() {
            let from = if maneuver.is_some() { &self.without_maneuver[i] } else { self.holds[i] };
            trajectory.branch_from(from, first);
            trajectory.loss = from.loss.filter(|loss| loss.step < first);
        }
        self.courses.forget();
        let mut bound = FormationBound { best_worth, so_far: 0.0 };
        if (1..first).any(|step| !bound.can_exceed(&self.trial, step)) {
            return false;
        }
        for step in first..=HORIZON {
            let t = step as usize;
            let bodies = self.trial.each_ref().map(|trajectory| trajectory.bodies[t - 1]);
            let keeps_formation =
                step <= gains.until && self.trial.iter().all(|trajectory| trajectory.loss.is_none());
            let burns = if keeps_formation {
                formation_burns(&bodies, gains, self.ephemeris.physics.gravity)
            } else {
                [(0.0, 0.0); SATELLITES]
            };
            let planned: [_; SATELLITES] = std::array::from_fn(|i| {
                let (dvx, dvy) = match maneuver.filter(|m| m.satellite == i) {
                    Some(m) if m.step == step => m.dv,
                    Some(m) if m.step < step && step < m.until => (0.0, 0.0),
                    _ => burns[i],
                };
                affordable_burn(dvx, dvy, self.trial[i].fuel[t - 1])
            });
            let flying = std::array::from_fn(|i| self.trial[i].loss.is_none().then_some(bodies[i]));
            let contacts = self.courses.contacts_of_plans(look_ahead, flying, planned, self.ephemeris, t - 1);
            for (i, trajectory) in self.trial.iter_mut().enumerate() {
                if trajectory.loss.is_some() {
                    continue;
                }
                let fuel = trajectory.fuel[t - 1];
                let burn = contacts[i].map_or(planned[i], |contact| {
                    look_ahead.avoid(contact, bodies[i], fuel, planned[i], self.ephemeris, t - 1)
                });
                trajectory.advance(self.ephemeris, step, burn);
            }
            if !bound.can_exceed(&self.trial, step) {
                return false;
            }
        }
        true
    }

    /// Score of a plan, plus one if its episode is a success.
    fn worth_of(&self, trajectories: &[Trajectory; SATELLITES]) -> f64 {
        let outcome = plan_outcome(
            Objective::Formation,
            self.setup,
            self.seed,
            self.ephemeris,
            trajectories.each_ref(),
        );
        let success = outcome.lost == 0 && outcome.goal.is_some_and(|goal| goal >= GOAL_THRESHOLD);
        outcome.score + f64::from(u8::from(success))
    }

    fn keep_if_better(&mut self) -> bool {
        let worth = self.worth_of(&self.trial);
        let is_better = worth > self.best_worth;
        if is_better {
            self.best_worth = worth;
            self.best.clone_from(&self.trial);
        }
        is_better
    }

    /// Draws one of the losses of the best plan so far.
    fn draw_loss(&self, rng: &mut SeededRng) -> Option<PlanLoss> {
        let losses: Vec<PlanLoss> = self
            .best
            .iter()
            .enumerate()
            .filter_map(|(satellite, trajectory)| Some(PlanLoss { satellite, step: trajectory.loss_step()? }))
            .collect();
        let index = rng.uniform_in(RngStream::Planner, 0.0, losses.len() as f64) as usize;
        losses.get(index).copied()
    }
}

/// Upper bound of the worth of a plan in progress.
struct FormationBound {
    /// Worth that the plan must exceed.
    best_worth: f64,
    /// Reward of the steps so far.
    so_far: f64,
}

impl FormationBound {
    /// Counts `step`. Returns false if even a perfect triangle in all later steps, without further losses, would not exceed
    /// the best. Fragments only lose more.
    fn can_exceed(&mut self, plan: &[Trajectory; SATELLITES], step: u32) -> bool {
        let t = step as usize;
        let survives = |trajectory: &Trajectory| trajectory.loss.is_none_or(|loss| step < loss.step);
        let survival = |trajectory: &Trajectory| {
            if survives(trajectory) { trajectory.survival[t] } else { 0.0 }
        };
        let fleet = FleetState {
            bodies: plan.each_ref().map(|trajectory| trajectory.bodies[t]),
            fuel: plan.each_ref().map(|trajectory| trajectory.fuel[t]),
            survival: plan.each_ref().map(survival),
        };
        let reward = |goal| Objective::Formation.reward(&fleet, 1.0, goal);
        self.so_far += reward(Objective::Formation.goal(&fleet));
        let later = f64::from(HORIZON - step) * reward(fleet.survival.iter().product());
        let bonus = f64::from(u8::from(plan.iter().all(survives)));
        score(self.so_far + later) + bonus > self.best_worth - ROUNDING
    }
}
