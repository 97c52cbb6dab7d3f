//! One episode of kessler, step by step, in the order that is part of the contract: burns, rogue arrival, motion,
//! contact, reward.

use super::constants::{EARTH_RADIUS_2, FRAGMENTS, GOAL_STEPS, HORIZON, SATELLITES};
use super::debris::Debris;
use super::event::Event;
use super::kernel::{Body, clamped_burn, distance_2};
use super::reward::{Objective, proximity, score};
use super::setup::{Setup, Start};
use crate::bracket::Flown;
use crate::chance::{Chance, Stream};
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
}

impl Satellite {
    /// Whether it flies.
    #[must_use]
    pub fn active(&self) -> bool {
        self.status == Status::Active
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
    setup: Setup,
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

impl<C: Chance> Flight<C> {
    /// The episode at its start.
    #[must_use]
    pub fn new(objective: Objective, setup: Setup, start: Start, chance: C) -> Self {
        let room = start.debris.len() + start.rogues.len() + SATELLITES * FRAGMENTS;
        let mut flight = Self {
            objective,
            chance,
            satellites: [Satellite { body: Body::default(), fuel: 0.0, status: Status::Lost }; SATELLITES],
            debris: Debris::with_room(room),
            rogues: Vec::new(),
            next_rogue: 0,
            step: 0,
            total: 0.0,
            goal_sum: 0.0,
            fuel_used: 0.0,
            done: false,
            events: Vec::with_capacity(16),
            setup,
        };
        flight.place(start);
        flight
    }

    /// Starts over from `start` with `chance`, keeping the memory.
    pub fn restart(&mut self, start: Start, chance: C) {
        self.chance = chance;
        self.place(start);
    }

    fn place(&mut self, start: Start) {
        let fuel = self.setup.fuel;
        self.satellites = start.satellites.map(|body| Satellite { body, fuel, status: Status::Active });
        self.debris.clear();
        for body in start.debris {
            self.debris.push(body);
        }
        self.rogues = start.rogues;
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
        let active_before = self.satellites.map(|s| s.active());
        self.step += 1;
        self.events.clear();
        if self.setup.upstream {
            for (i, &agent) in action.agents.iter().enumerate() {
                if (agent as usize) < SATELLITES {
                    self.burn(agent as usize, action.values[2 * i], action.values[2 * i + 1]);
                }
            }
        } else if !action.agents.is_empty() {
            self.burn_summed(action);
        }
        self.arrive();
        self.coast();
        self.contacts();
        let reward = self.reward();
        self.total += reward;
        self.done = self.step == HORIZON || self.satellites.iter().all(|s| !s.active());
        Ok(Stepped { reward, active_before, done: self.done })
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
            if agent as usize >= SATELLITES && !self.setup.upstream {
                return Err(StepError::UnknownAgent { agent, last: SATELLITES as u32 - 1 });
            }
            if !(action.values[2 * i].is_finite() && action.values[2 * i + 1].is_finite()) {
                return Err(StepError::NotFinite { agent });
            }
        }
        Ok(())
    }

    /// The deltas of one satellite are summed, then clamped and charged once.
    fn burn_summed(&mut self, action: JointAction<'_>) {
        let mut sums = [(0.0f64, 0.0f64); SATELLITES];
        let mut acts = [false; SATELLITES];
        for (i, &agent) in action.agents.iter().enumerate() {
            let sum = &mut sums[agent as usize];
            sum.0 += action.values[2 * i];
            sum.1 += action.values[2 * i + 1];
            acts[agent as usize] = true;
        }
        for satellite in 0..SATELLITES {
            if acts[satellite] {
                self.burn(satellite, sums[satellite].0, sums[satellite].1);
            }
        }
    }

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

    fn coast(&mut self) {
        for (i, s) in self.satellites.iter_mut().enumerate() {
            if !s.active() {
                continue;
            }
            if s.body.radius_2() < EARTH_RADIUS_2 {
                s.status = Status::Lost;
                self.events.push(Event::Decayed { satellite: i as u32 });
            } else {
                s.body = s.body.coasted();
            }
        }
        if self.debris.may_be_inside {
            if self.setup.upstream {
                self.debris.coast_frozen();
                return;
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
        self.debris.coast();
    }

    fn contacts(&mut self) {
        for i in 0..SATELLITES {
            let s = self.satellites[i];
            if !s.active() {
                continue;
            }
            let Some(hit) = self.debris.touching(s.body.x, s.body.y) else { continue };
            self.satellites[i].status = Status::Lost;
            self.events.push(Event::Collision { satellite: i as u32, debris: self.debris.id(hit) });
            for _ in 0..FRAGMENTS {
                let fragment = fragment(s.body, &mut self.chance);
                self.debris.push(fragment);
            }
        }
    }

    fn reward(&mut self) -> f64 {
        let mut active = 0;
        let mut fuel = 0.0;
        for s in self.satellites.iter().filter(|s| s.active()) {
            active += 1;
            fuel += s.fuel;
        }
        let first = &self.satellites[0];
        let near = if self.objective == Objective::Rendezvous && first.active() {
            proximity(first.body.radius())
        } else {
            0.0
        };
        if self.step > HORIZON - GOAL_STEPS {
            self.goal_sum += near;
        }
        self.objective.reward(active, fuel, self.setup.fuel, near)
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
    pub const fn setup(&self) -> &Setup {
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

    /// A digest of every bit of the state.
    #[must_use]
    pub fn state_hash(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        let mut put = |value: f64| {
            hasher.update(&value.to_bits().to_le_bytes());
        };
        for s in &self.satellites {
            for value in [s.body.x, s.body.y, s.body.vx, s.body.vy, s.fuel, f64::from(u8::from(s.active()))] {
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
        let lost = self.satellites.iter().filter(|s| !s.active()).count();
        Flown {
            score: score(self.total),
            total: self.total,
            steps: self.step,
            lost: lost as u32,
            goal: (self.objective == Objective::Rendezvous).then(|| self.goal_sum / f64::from(GOAL_STEPS)),
            fuel_used: self.fuel_used,
        }
    }
}

/// A fragment appears at the satellite, with its velocity plus a kick U(−1, 1)².
pub(crate) fn fragment(of: Body, chance: &mut impl Chance) -> Body {
    let mut kick = || chance.between(Stream::Fragments, -1.0, 1.0);
    let (kx, ky) = (kick(), kick());
    Body { vx: of.vx + kx, vy: of.vy + ky, ..of }
}
