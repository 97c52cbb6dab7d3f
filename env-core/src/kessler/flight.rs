//! One episode of kessler, step by step, in the order that is part of the contract: burns, rogue arrival, motion,
//! contact, reward.

mod account;
mod encounter;
mod satellite;

use std::sync::Arc;

pub(crate) use self::encounter::fragment;
pub use self::satellite::{Satellite, Status};
use super::constants::{EARTH_RADIUS_2, HORIZON, SATELLITES};
use super::debris::{ABSENT, Debris};
use super::event::Event;
use super::kernel::{Body, clamped_burn};
use super::reward::{Fleet, Objective};
use super::setup::{Contact, Draft, Setup, Start};
use crate::chance::{Chance, Seeded};
use crate::error::{ScenarioError, StepError};
use crate::log::JointAction;
use crate::seed::Seed;

/// What a step gave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stepped {
    /// The team's reward.
    pub reward: f64,
    /// Which satellites were active before the step.
    pub active_before: [bool; SATELLITES],
    /// The episode is over.
    pub done: bool,
}

/// One episode in flight.
#[derive(Debug, Clone)]
pub struct Flight<C> {
    objective: Objective,
    setup: Arc<Setup>,
    chance: C,
    satellites: [Satellite; SATELLITES],
    debris: Debris,
    rogues: Vec<(u32, Body)>,
    next_rogue: usize,
    step: u32,
    total: f64,
    goal_sum: f64,
    fuel_used: f64,
    done: bool,
    events: Vec<Event>,
}

impl Flight<Seeded> {
    /// What the next episode rewards.
    pub(super) const fn set_objective(&mut self, objective: Objective) {
        self.objective = objective;
    }

    /// Starts over with the draws of this seed, and with another setup where one is given, in the same memory.
    ///
    /// # Errors
    /// Where the setup cannot start; there is no episode then.
    pub(super) fn draw(&mut self, setup: Option<Arc<Setup>>, seed: Seed) -> Result<(), ScenarioError> {
        if let Some(setup) = setup {
            self.setup = setup;
        }
        self.chance.reseed(seed);
        let mut satellites = [ABSENT; SATELLITES];
        let (debris, rogues) = (self.debris.cloud(), &mut self.rogues);
        let draft = Draft { satellites: &mut satellites, debris, rogues };
        let drawn = self.setup.start_into(&mut self.chance, draft);
        if drawn.is_err() {
            self.debris.cloud().clear(0);
            self.rogues.clear();
        }
        self.begin(&satellites);
        drawn
    }
}

/// Events of one step that there is room for from the start.
const EVENTS: usize = 32;

impl<C: Chance> Flight<C> {
    /// The episode at its start.
    #[must_use]
    pub fn new(objective: Objective, setup: impl Into<Arc<Setup>>, start: &Start, chance: C) -> Self {
        let nobody = Satellite { body: ABSENT, fuel: 0.0, status: Status::Lost, survival: 0.0 };
        let mut flight = Self {
            objective,
            chance,
            satellites: [nobody; SATELLITES],
            debris: Debris::new(),
            rogues: Vec::new(),
            next_rogue: 0,
            step: 0,
            total: 0.0,
            goal_sum: 0.0,
            fuel_used: 0.0,
            done: false,
            events: Vec::with_capacity(EVENTS),
            setup: setup.into(),
        };
        flight.place(start);
        flight
    }

    /// Starts over from `start`, keeping the memory; `chance` has made its draws.
    pub fn restart(&mut self, start: &Start, chance: C) {
        self.chance = chance;
        self.place(start);
    }

    /// Puts everything back to `start`; the draws for it have been made.
    fn place(&mut self, start: &Start) {
        let cloud = self.debris.cloud();
        cloud.clear(self.setup.most_debris());
        for body in &start.debris {
            cloud.push(*body);
        }
        self.rogues.clear();
        self.rogues.reserve(self.setup.most_rogues());
        self.rogues.extend_from_slice(&start.rogues);
        self.begin(&start.satellites);
    }

    /// Begins with the debris and rogues that were put in place.
    fn begin(&mut self, satellites: &[Body; SATELLITES]) {
        let fuel = self.setup.fuel;
        self.satellites =
            satellites.map(|body| Satellite { body, fuel, status: Status::Active, survival: 1.0 });
        self.debris.begin(self.setup.most_debris());
        if let Contact::Chance(_) = self.setup.physics.contact {
            self.debris.look_at(satellites);
        }
        self.next_rogue = 0;
        self.step = 0;
        self.total = 0.0;
        self.goal_sum = 0.0;
        self.fuel_used = 0.0;
        self.done = false;
        self.events.clear();
    }

    /// One step. An action is (satellite; dvx, dvy in LU/TU).
    ///
    /// # Errors
    /// An action that is not taken; nothing has changed then.
    pub fn step(&mut self, action: JointAction<'_>) -> Result<Stepped, StepError> {
        self.check(action)?;
        if self.setup.physics.upstream {
            let active_before = self.begin_step();
            for (i, &agent) in action.agents.iter().enumerate() {
                if (agent as usize) < SATELLITES {
                    self.burn(agent as usize, action.values[2 * i], action.values[2 * i + 1]);
                }
            }
            return Ok(self.advance(active_before));
        }
        // The deltas of one satellite are summed, then clamped and charged once.
        let mut sums = [None; SATELLITES];
        for (i, &agent) in action.agents.iter().enumerate() {
            let (x, y) = sums[agent as usize].unwrap_or((0.0, 0.0));
            sums[agent as usize] = Some((x + action.values[2 * i], y + action.values[2 * i + 1]));
        }
        Ok(self.step_all(|satellite| sums[satellite]))
    }

    /// One step of an episode that is not over; of each satellite its burn, if any, in finite numbers.
    #[inline(always)]
    pub(super) fn step_all(&mut self, burn: impl Fn(usize) -> Option<(f64, f64)>) -> Stepped {
        let active_before = self.begin_step();
        for satellite in 0..SATELLITES {
            if let Some((dvx, dvy)) = burn(satellite) {
                self.burn(satellite, dvx, dvy);
            }
        }
        self.advance(active_before)
    }

    #[inline(always)]
    fn begin_step(&mut self) -> [bool; SATELLITES] {
        self.step += 1;
        self.events.clear();
        self.satellites.each_ref().map(Satellite::active)
    }

    /// Everything after the burns.
    #[inline]
    fn advance(&mut self, active_before: [bool; SATELLITES]) -> Stepped {
        self.arrive();
        let touched = self.coast();
        match self.setup.physics.contact {
            Contact::Chance(sigma) => self.passings(sigma),
            Contact::EndOfStep | Contact::Swept if touched => self.contacts(),
            Contact::EndOfStep | Contact::Swept => {}
        }
        let reward = self.reward();
        self.total += reward;
        self.done = self.step == HORIZON || self.satellites.iter().all(|s| !s.active());
        Stepped { reward, active_before, done: self.done }
    }

    fn check(&self, action: JointAction<'_>) -> Result<(), StepError> {
        if self.done {
            return Err(StepError::Ended { step: self.step });
        }
        action.check(2, (!self.setup.physics.upstream).then_some(SATELLITES))
    }

    #[inline]
    fn burn(&mut self, satellite: usize, dvx: f64, dvy: f64) {
        let s = &mut self.satellites[satellite];
        if !s.active() {
            return;
        }
        let (dvx, dvy, cost) = clamped_burn(dvx, dvy);
        if cost <= s.fuel {
            s.fuel -= cost;
            s.body.vx += dvx;
            s.body.vy += dvy;
            self.fuel_used += cost;
        } else {
            self.events.push(Event::BurnRefused { satellite: satellite as u32, cost });
        }
    }

    #[inline]
    fn arrive(&mut self) {
        while let Some(&(step, body)) = self.rogues.get(self.next_rogue) {
            if step > self.step {
                break;
            }
            self.next_rogue += 1;
            let debris = self.debris.push(body);
            self.events.push(Event::RogueArrived { debris });
        }
    }

    /// Satellites, then debris. True if some satellite may have been touched.
    #[inline]
    fn coast(&mut self) -> bool {
        let physics = self.setup.physics;
        let mut there = [ABSENT; SATELLITES];
        for (i, s) in self.satellites.iter_mut().enumerate() {
            if !s.active() {
                continue;
            }
            if s.body.radius_2() < EARTH_RADIUS_2 {
                s.lose();
                self.events.push(Event::Decayed { satellite: i as u32 });
            } else {
                s.body = s.body.coasted(physics.gravity);
                there[i] = s.body;
            }
        }
        if self.debris.may_be_inside {
            if physics.upstream {
                self.debris.advance_frozen();
                return true;
            }
            let mut i = 0;
            while i < self.debris.len() {
                if self.debris.body(i).radius_2() < EARTH_RADIUS_2 {
                    self.events.push(Event::DebrisDecayed { debris: self.debris.id(i) });
                    self.debris.remove(i);
                } else {
                    i += 1;
                }
            }
        }
        self.debris.advance(physics.gravity, physics.contact == Contact::Swept, &there)
    }

    #[inline]
    fn reward(&mut self) -> f64 {
        let fleet = Fleet {
            bodies: self.satellites.each_ref().map(|s| s.body),
            fuel: self.satellites.each_ref().map(|s| s.fuel),
            alive: self.satellites.each_ref().map(|s| s.survival),
        };
        let goal = self.objective.goal(&fleet);
        if self.step > HORIZON - self.objective.goal_steps() {
            self.goal_sum += goal;
        }
        self.objective.reward(&fleet, self.setup.fuel, goal)
    }
}
