//! One episode of kessler, step by step, in the order that is part of the contract: burns, rogue arrival, motion,
//! contact, reward.

mod encounter;

use std::sync::Arc;

pub(crate) use self::encounter::fragment;
use super::constants::{EARTH_RADIUS_2, HORIZON, SATELLITES, SURVIVED};
use super::debris::{ABSENT, Debris};
use super::event::Event;
use super::kernel::{Body, clamped_burn, distance_2};
use super::reward::{Fleet, Objective, score};
use super::setup::{Contact, Setup, Start};
use crate::bracket::Flown;
use crate::chance::Chance;
use crate::error::StepError;
use crate::log::{JointAction, MAX_ENTRIES};

/// What became of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// It flies.
    Active,
    /// It was hit, or fell into the Earth.
    Lost,
}

/// One satellite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Satellite {
    /// Where it is and how it moves.
    pub body: Body,
    /// Fuel left.
    pub fuel: f64,
    /// Whether it flies.
    pub status: Status,
    /// Probability that it still flies: 1 or 0, or under `risk: pc` the product over its encounters of 1 − Pc.
    pub survival: f64,
}

impl Satellite {
    /// Whether it flies.
    #[must_use]
    pub fn active(&self) -> bool {
        self.status == Status::Active
    }

    /// Whether it counts as lost.
    #[must_use]
    pub fn lost(&self) -> bool {
        !self.active() || self.survival < SURVIVED
    }

    fn lose(&mut self) {
        self.status = Status::Lost;
        self.survival = 0.0;
    }
}

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

    /// Its parts, for a start in the same memory: the setup, which may be replaced, and the draws.
    pub(super) fn parts(&mut self) -> (&mut Arc<Setup>, &mut C) {
        (&mut self.setup, &mut self.chance)
    }

    /// Puts everything back to `start`; the draws for it have been made.
    pub(super) fn place(&mut self, start: &Start) {
        let fuel = self.setup.fuel;
        self.satellites =
            start.satellites.map(|body| Satellite { body, fuel, status: Status::Active, survival: 1.0 });
        self.debris.load(&start.debris, self.setup.most_debris());
        if let Contact::Chance(_) = self.setup.physics.contact {
            self.debris.look_at(&start.satellites);
        }
        self.rogues.clear();
        self.rogues.reserve(self.setup.most_rogues());
        self.rogues.extend_from_slice(&start.rogues);
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
            let active_before = self.begin();
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
        Ok(self.step_all(sums))
    }

    /// One step of an episode that is not over, one optional burn a satellite, each a finite number.
    pub(super) fn step_all(&mut self, burns: [Option<(f64, f64)>; SATELLITES]) -> Stepped {
        let active_before = self.begin();
        for (satellite, burn) in burns.into_iter().enumerate() {
            if let Some((dvx, dvy)) = burn {
                self.burn(satellite, dvx, dvy);
            }
        }
        self.advance(active_before)
    }

    fn begin(&mut self) -> [bool; SATELLITES] {
        self.step += 1;
        self.events.clear();
        self.satellites.map(|s| s.active())
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
        let entries = action.agents.len();
        if entries > MAX_ENTRIES {
            return Err(StepError::TooMany { count: entries, max: MAX_ENTRIES });
        }
        if action.values.len() != 2 * entries {
            return Err(StepError::Shape { values: action.values.len(), entries, dim: 2 });
        }
        for (i, &agent) in action.agents.iter().enumerate() {
            if agent as usize >= SATELLITES && !self.setup.physics.upstream {
                return Err(StepError::UnknownAgent { agent, last: SATELLITES as u32 - 1 });
            }
            if !(action.values[2 * i].is_finite() && action.values[2 * i + 1].is_finite()) {
                return Err(StepError::NotFinite { agent });
            }
        }
        Ok(())
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
        for (i, s) in self.satellites.iter_mut().enumerate() {
            if !s.active() {
                continue;
            }
            if s.body.radius_2() < EARTH_RADIUS_2 {
                s.lose();
                self.events.push(Event::Decayed { satellite: i as u32 });
            } else {
                s.body = s.body.coasted(physics.gravity);
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
        let there = self.satellites.map(|s| if s.active() { s.body } else { ABSENT });
        self.debris.advance(physics.gravity, physics.contact == Contact::Swept, &there)
    }

    #[inline]
    fn reward(&mut self) -> f64 {
        let fleet = Fleet {
            bodies: self.satellites.map(|s| s.body),
            fuel: self.satellites.map(|s| s.fuel),
            alive: self.satellites.map(|s| s.survival),
        };
        let goal = self.objective.goal(&fleet);
        if self.step > HORIZON - self.objective.goal_steps() {
            self.goal_sum += goal;
        }
        self.objective.reward(&fleet, self.setup.fuel, goal)
    }

    /// Whether some active satellite's radar sees this place.
    #[must_use]
    pub fn sees(&self, x: f64, y: f64) -> bool {
        self.setup.radar_range.is_none_or(|range| {
            self.satellites
                .iter()
                .any(|s| s.active() && distance_2(s.body.x, s.body.y, x, y) <= range * range)
        })
    }

    /// The satellites.
    #[must_use]
    pub const fn satellites(&self) -> &[Satellite; SATELLITES] {
        &self.satellites
    }

    /// All debris, hidden or not.
    #[must_use]
    pub const fn debris(&self) -> &Debris {
        &self.debris
    }

    /// What happened in the last step.
    #[must_use]
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Steps taken.
    #[must_use]
    pub const fn steps(&self) -> u32 {
        self.step
    }

    /// Whether it is over.
    #[must_use]
    pub const fn done(&self) -> bool {
        self.done
    }

    /// The sum of rewards.
    #[must_use]
    pub const fn total(&self) -> f64 {
        self.total
    }

    /// The recipe in kessler's terms.
    #[must_use]
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// What the task rewards.
    #[must_use]
    pub const fn objective(&self) -> Objective {
        self.objective
    }

    /// The source of draws.
    #[must_use]
    pub const fn chance(&self) -> &C {
        &self.chance
    }

    /// Bytes it takes, without the setup, which others may share.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + self.debris.bytes()
            + self.rogues.capacity() * size_of::<(u32, Body)>()
            + self.events.capacity() * size_of::<Event>()
    }

    /// A digest of every bit of the state.
    #[must_use]
    pub fn state_hash(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        let mut put = |value: f64| {
            hasher.update(&value.to_bits().to_le_bytes());
        };
        for s in &self.satellites {
            for value in [s.body.x, s.body.y, s.body.vx, s.body.vy, s.fuel, s.survival] {
                put(value);
            }
        }
        for i in 0..self.debris.len() {
            let body = self.debris.body(i);
            for value in [f64::from(self.debris.id(i)), body.x, body.y, body.vx, body.vy] {
                put(value);
            }
        }
        put(f64::from(self.step));
        put(self.total);
        put(self.goal_sum);
        *hasher.finalize().as_bytes()
    }

    /// How it went so far.
    #[must_use]
    pub fn flown(&self) -> Flown {
        let lost = self.satellites.iter().filter(|s| s.lost()).count();
        let steps = self.objective.goal_steps();
        Flown {
            score: score(self.total),
            total: self.total,
            steps: self.step,
            lost: lost as u32,
            goal: (steps > 0).then(|| self.goal_sum / f64::from(steps)),
            fuel_used: self.fuel_used,
        }
    }
}
