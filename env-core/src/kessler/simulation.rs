//! The engine of kessler: one episode, step by step. The order within a step is part of the contract: burns,
//! arrival of rogue debris, motion, contact, reward. `contacts` resolves encounters, `queries` reads the
//! state, `satellite` holds one satellite.

mod contacts;
mod queries;
mod satellite;

use std::sync::Arc;

pub(crate) use self::contacts::draw_fragment;
pub use self::satellite::{Satellite, SatelliteStatus};
use super::constants::{EARTH_RADIUS_2, HORIZON, SATELLITES};
use super::debris::{ABSENT_SATELLITE, Debris};
use super::event::KesslerEvent;
use super::kernel::{Body, ClampedBurn, clamp_burn};
use super::reward::{FleetState, Objective};
use super::setup::{ContactModel, InitialState, KesslerSetup, RogueArrival, StateBuffers};
use crate::episode_rng::{EpisodeRng, SeededRng};
use crate::error::{ScenarioError, StepError};
use crate::log::JointAction;
use crate::seed::Seed;

/// Result of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KesslerStep {
    /// Team reward of the step.
    pub reward: f64,
    /// Satellites that were active before the step.
    pub active_before: [bool; SATELLITES],
    /// True if the episode is over.
    pub done: bool,
}

/// State of one episode. It can start over without allocating.
#[derive(Debug, Clone)]
pub struct KesslerSim<R> {
    objective: Objective,
    setup: Arc<KesslerSetup>,
    rng: R,
    satellites: [Satellite; SATELLITES],
    debris: Debris,
    rogues: Vec<RogueArrival>,
    next_rogue: usize,
    step: u32,
    total_reward: f64,
    goal_sum: f64,
    fuel_used: f64,
    done: bool,
    events: Vec<KesslerEvent>,
}

impl KesslerSim<SeededRng> {
    /// Sets the objective of the next episode.
    pub(super) const fn set_objective(&mut self, objective: Objective) {
        self.objective = objective;
    }

    /// Starts over in the same memory with the draws of `seed`, and with `setup` if given.
    ///
    /// # Errors
    /// Returns [`ScenarioError::Unfair`] if the setup has no fair start. There is no valid episode then.
    pub(super) fn reset_from_seed(
        &mut self,
        setup: Option<Arc<KesslerSetup>>,
        seed: Seed,
    ) -> Result<(), ScenarioError> {
        if let Some(setup) = setup {
            self.setup = setup;
        }
        self.rng.reseed(seed);
        let mut satellites = [ABSENT_SATELLITE; SATELLITES];
        let (debris, rogues) = (self.debris.initial_bodies_mut(), &mut self.rogues);
        let buffers = StateBuffers { satellites: &mut satellites, debris, rogues };
        let drawn = self.setup.draw_into(&mut self.rng, buffers);
        if drawn.is_err() {
            self.debris.initial_bodies_mut().clear(0);
            self.rogues.clear();
        }
        self.begin_episode(&satellites);
        drawn
    }
}

/// Number of events of one step that fit without an allocation.
const EVENT_CAPACITY: usize = 32;

impl<R: EpisodeRng> KesslerSim<R> {
    /// Creates an episode at its start. `rng` has already made the draws of `start`.
    #[must_use]
    pub fn new(
        objective: Objective,
        setup: impl Into<Arc<KesslerSetup>>,
        start: &InitialState,
        rng: R,
    ) -> Self {
        let absent =
            Satellite { body: ABSENT_SATELLITE, fuel: 0.0, status: SatelliteStatus::Lost, survival: 0.0 };
        let mut sim = Self {
            objective,
            rng,
            satellites: [absent; SATELLITES],
            debris: Debris::new(),
            rogues: Vec::new(),
            next_rogue: 0,
            step: 0,
            total_reward: 0.0,
            goal_sum: 0.0,
            fuel_used: 0.0,
            done: false,
            events: Vec::with_capacity(EVENT_CAPACITY),
            setup: setup.into(),
        };
        sim.load(start);
        sim
    }

    /// Starts over from `start` in the same memory. `rng` has already made the draws of `start`.
    pub fn reset(&mut self, start: &InitialState, rng: R) {
        self.rng = rng;
        self.load(start);
    }

    /// Advances the episode by one step. Each entry of the action holds a satellite and its dvx, dvy in
    /// LU/TU.
    ///
    /// # Errors
    /// Returns [`StepError::Ended`] after the end of the episode, and the errors of [`JointAction`] for an
    /// invalid action. The state does not change then.
    pub fn step(&mut self, action: JointAction<'_>) -> Result<KesslerStep, StepError> {
        self.check_action(action)?;
        if self.setup.physics.upstream_compat {
            let active_before = self.begin_step();
            for (i, &agent) in action.agents.iter().enumerate() {
                if (agent as usize) < SATELLITES {
                    self.apply_burn(agent as usize, action.values[2 * i], action.values[2 * i + 1]);
                }
            }
            return Ok(self.advance(active_before));
        }
        // The deltas of one satellite are summed, then clamped and charged once.
        let mut sums = [None; SATELLITES];
        for (i, &agent) in action.agents.iter().enumerate() {
            let (dvx, dvy) = sums[agent as usize].unwrap_or((0.0, 0.0));
            sums[agent as usize] = Some((dvx + action.values[2 * i], dvy + action.values[2 * i + 1]));
        }
        Ok(self.step_with(|satellite| sums[satellite]))
    }

    /// Advances an episode that is not over by one step. `burn` gives the dvx, dvy of each satellite, if any,
    /// in finite LU/TU.
    #[inline(always)]
    pub(super) fn step_with(&mut self, burn: impl Fn(usize) -> Option<(f64, f64)>) -> KesslerStep {
        let active_before = self.begin_step();
        for satellite in 0..SATELLITES {
            if let Some((dvx, dvy)) = burn(satellite) {
                self.apply_burn(satellite, dvx, dvy);
            }
        }
        self.advance(active_before)
    }

    /// Copies `start` into the state and begins the episode.
    fn load(&mut self, start: &InitialState) {
        let bodies = self.debris.initial_bodies_mut();
        bodies.clear(self.setup.max_debris());
        for body in &start.debris {
            bodies.push(*body);
        }
        self.rogues.clear();
        self.rogues.reserve(self.setup.max_rogues());
        self.rogues.extend_from_slice(&start.rogues);
        self.begin_episode(&start.satellites);
    }

    /// Resets everything but the initial debris and the rogues, which the caller has stored.
    fn begin_episode(&mut self, satellites: &[Body; SATELLITES]) {
        let fuel = self.setup.fuel;
        self.satellites =
            satellites.map(|body| Satellite { body, fuel, status: SatelliteStatus::Active, survival: 1.0 });
        self.debris.reset(self.setup.max_debris());
        if let ContactModel::Probability(_) = self.setup.physics.contact {
            self.debris.record_approaching(satellites);
        }
        self.next_rogue = 0;
        self.step = 0;
        self.total_reward = 0.0;
        self.goal_sum = 0.0;
        self.fuel_used = 0.0;
        self.done = false;
        self.events.clear();
    }

    fn check_action(&self, action: JointAction<'_>) -> Result<(), StepError> {
        if self.done {
            return Err(StepError::Ended { step: self.step });
        }
        action.check(2, (!self.setup.physics.upstream_compat).then_some(SATELLITES))
    }

    #[inline(always)]
    fn begin_step(&mut self) -> [bool; SATELLITES] {
        self.step += 1;
        self.events.clear();
        self.satellites.each_ref().map(Satellite::is_active)
    }

    #[inline]
    fn apply_burn(&mut self, satellite: usize, dvx: f64, dvy: f64) {
        let s = &mut self.satellites[satellite];
        if !s.is_active() {
            return;
        }
        let ClampedBurn { dvx, dvy, cost } = clamp_burn(dvx, dvy);
        if cost <= s.fuel {
            s.fuel -= cost;
            s.body.vx += dvx;
            s.body.vy += dvy;
            self.fuel_used += cost;
        } else {
            self.events.push(KesslerEvent::BurnRejected { satellite: satellite as u32, cost });
        }
    }

    /// Runs all of a step that comes after the burns.
    #[inline]
    fn advance(&mut self, active_before: [bool; SATELLITES]) -> KesslerStep {
        self.spawn_rogues();
        let may_touch = self.propagate();
        match self.setup.physics.contact {
            ContactModel::Probability(sigma) => self.apply_close_approaches(sigma),
            ContactModel::EndOfStep | ContactModel::Swept if may_touch => self.resolve_contacts(),
            ContactModel::EndOfStep | ContactModel::Swept => {}
        }
        let reward = self.compute_reward();
        self.total_reward += reward;
        self.done = self.step == HORIZON || self.satellites.iter().all(|s| !s.is_active());
        KesslerStep { reward, active_before, done: self.done }
    }

    #[inline]
    fn spawn_rogues(&mut self) {
        while let Some(&RogueArrival { step, body }) = self.rogues.get(self.next_rogue) {
            if step > self.step {
                break;
            }
            self.next_rogue += 1;
            let debris = self.debris.push(body);
            self.events.push(KesslerEvent::RogueArrived { debris });
        }
    }

    /// Moves the satellites, then the debris. Returns true if some satellite may have been touched.
    #[inline]
    fn propagate(&mut self) -> bool {
        let physics = self.setup.physics;
        let mut positions = [ABSENT_SATELLITE; SATELLITES];
        for (i, s) in self.satellites.iter_mut().enumerate() {
            if !s.is_active() {
                continue;
            }
            if s.body.radius_squared() < EARTH_RADIUS_2 {
                s.lose();
                self.events.push(KesslerEvent::Decayed { satellite: i as u32 });
            } else {
                s.body = s.body.coast(physics.gravity);
                positions[i] = s.body;
            }
        }
        if self.debris.may_be_inside_earth {
            if physics.upstream_compat {
                self.debris.advance_upstream();
                return true;
            }
            self.remove_decayed_debris();
        }
        self.debris.advance(physics.gravity, physics.contact == ContactModel::Swept, &positions)
    }

    fn remove_decayed_debris(&mut self) {
        let mut i = 0;
        while i < self.debris.len() {
            if self.debris.body(i).radius_squared() < EARTH_RADIUS_2 {
                self.events.push(KesslerEvent::DebrisDecayed { debris: self.debris.id(i) });
                self.debris.remove(i);
            } else {
                i += 1;
            }
        }
    }

    #[inline]
    fn compute_reward(&mut self) -> f64 {
        let fleet = FleetState {
            bodies: self.satellites.each_ref().map(|s| s.body),
            fuel: self.satellites.each_ref().map(|s| s.fuel),
            survival: self.satellites.each_ref().map(|s| s.survival),
        };
        let goal = self.objective.goal(&fleet);
        if self.step > HORIZON - self.objective.goal_steps() {
            self.goal_sum += goal;
        }
        self.objective.reward(&fleet, self.setup.fuel, goal)
    }
}
