//! One episode of docking, step by step, in the order that is part of the contract: thrust and motion of every deputy,
//! ends of each by itself, collisions among those left, rewards.

use serde::{Deserialize, Serialize};

use super::constants::{
    COLLISION_DISTANCE_M, MAX_DEPUTIES, OBSERVATION, POSITION_SCALE_M, VELOCITY_SCALE_M_S,
};
use super::deputy::Deputy;
use super::event::Event;
use super::relative::{State, Step, distance, limit_line, separation, speed, speed_limit};
use super::reward::Reward;
use super::setup::{Setup, Start};
use crate::bracket::Flown;
use crate::canonical::StateHasher;
use crate::error::StepError;
use crate::log::JointAction;

/// Thrusts of all deputies over one step, N per axis.
pub type Thrusts = [[f64; 3]; MAX_DEPUTIES];

/// What became of a deputy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// It flies.
    Active,
    /// It docked.
    Docked,
    /// It came within the docking radius too fast.
    Crashed,
    /// It flew too far away.
    OutOfBounds,
    /// It violated the speed limit for too long.
    Saturated,
    /// Two deputies collided: it was one of them, or flew when that ended the episode.
    Collided,
    /// Time ran out.
    TimedOut,
}

/// Every rule by which a deputy left in a step: several can hold at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ends {
    /// The time limit was reached.
    pub timeout: bool,
    /// Out of bounds.
    pub out_of_bounds: bool,
    /// A crash.
    pub crash: bool,
    /// A docking.
    pub docked: bool,
    /// The velocity reward reached its least.
    pub saturated: bool,
    /// Deputies collided.
    pub collision: bool,
}

impl Ends {
    /// Whether any holds.
    #[must_use]
    pub const fn any(self) -> bool {
        self.timeout || self.out_of_bounds || self.crash || self.docked || self.saturated || self.collision
    }

    /// The one that names the deputy's fate: a docking is one even as time runs out.
    #[must_use]
    pub const fn status(self) -> Status {
        match self {
            Self { docked: true, .. } => Status::Docked,
            Self { crash: true, .. } => Status::Crashed,
            Self { out_of_bounds: true, .. } => Status::OutOfBounds,
            Self { saturated: true, .. } => Status::Saturated,
            Self { collision: true, .. } => Status::Collided,
            Self { timeout: true, .. } => Status::TimedOut,
            _ => Status::Active,
        }
    }
}

/// What a step gave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stepped {
    /// Which deputies flew before the step.
    pub live_before: [bool; MAX_DEPUTIES],
    /// Their rewards; zero for the others.
    pub rewards: [Reward; MAX_DEPUTIES],
    /// The team's reward: the mean over the initial deputies.
    pub reward: f64,
    /// The episode is over.
    pub done: bool,
}

/// One episode in flight.
#[derive(Debug, Clone)]
pub struct Flight {
    setup: Setup,
    law: &'static Step,
    count: usize,
    deputies: [Deputy; MAX_DEPUTIES],
    step: u32,
    total: f64,
    delta_v: f64,
    done: bool,
    events: Vec<Event>,
}

/// Most events of one step: four ends of each deputy, and every pair.
const MAX_EVENTS: usize = 4 * MAX_DEPUTIES + MAX_DEPUTIES * (MAX_DEPUTIES - 1) / 2;

impl Flight {
    /// The episode at its start.
    #[must_use]
    pub fn new(setup: Setup, start: &Start) -> Self {
        let mut flight = Self {
            setup,
            law: Step::one(),
            count: 0,
            deputies: [Deputy::default(); MAX_DEPUTIES],
            step: 0,
            total: 0.0,
            delta_v: 0.0,
            done: false,
            events: Vec::with_capacity(MAX_EVENTS),
        };
        flight.restart(start);
        flight
    }

    /// Starts over from `start`, keeping the memory.
    pub fn restart(&mut self, start: &Start) {
        self.count = start.deputies.clamp(1, MAX_DEPUTIES);
        self.deputies = start.states.map(Deputy::at);
        self.step = 0;
        self.total = 0.0;
        self.delta_v = 0.0;
        self.done = false;
        self.events.clear();
    }

    /// Another recipe for the next start.
    pub(super) const fn set_up(&mut self, setup: Setup) {
        self.setup = setup;
    }

    /// Bytes it takes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + self.events.capacity() * size_of::<Event>()
    }

    /// One step. An action is (deputy; thrust on x, y, z in N), held for the step: a deputy without one coasts. Several
    /// of one deputy are added up, then each axis is clamped. Those of deputies that have left are ignored.
    ///
    /// # Errors
    /// An action that is not taken; nothing has changed then.
    pub fn step(&mut self, action: JointAction<'_>) -> Result<Stepped, StepError> {
        self.check(action)?;
        let mut thrusts = [[0.0; 3]; MAX_DEPUTIES];
        for (i, &agent) in action.agents.iter().enumerate() {
            let sum = &mut thrusts[agent as usize];
            for (axis, total) in sum.iter_mut().enumerate() {
                *total += action.values[3 * i + axis];
            }
        }
        Ok(self.fly(thrusts))
    }

    fn check(&self, action: JointAction<'_>) -> Result<(), StepError> {
        if self.done {
            return Err(StepError::Ended { step: self.step });
        }
        action.check(3, Some(self.count))
    }

    /// One step under thrusts that are numbers, whatever their size: the batch engine's way in. Each axis is clamped. An
    /// episode that is over stays as it is.
    pub fn fly(&mut self, thrusts: Thrusts) -> Stepped {
        let mut stepped = Stepped {
            live_before: self.live(),
            rewards: [Reward::default(); MAX_DEPUTIES],
            reward: 0.0,
            done: self.done,
        };
        if self.done {
            return stepped;
        }
        self.step += 1;
        self.events.clear();
        let mut sum = 0.0;
        for (i, thrust) in thrusts.into_iter().enumerate() {
            if stepped.live_before[i] {
                let moved = self.deputies[i].fly(self.law, &self.setup, self.step, thrust);
                stepped.rewards[i] = moved.reward;
                self.delta_v += moved.delta_v;
                sum += moved.reward.total();
                if !self.deputies[i].flies() {
                    self.tell(i);
                }
            }
        }
        if self.count > 1 {
            self.collide();
        }
        stepped.reward = sum / self.count as f64;
        self.total += stepped.reward;
        self.done = !self.deputies().iter().any(Deputy::flies);
        stepped.done = self.done;
        stepped
    }

    /// The events of a deputy that leaves.
    #[cold]
    fn tell(&mut self, i: usize) {
        let Deputy { state, velocity_sum, ends, .. } = self.deputies[i];
        let (deputy, distance, speed) = (i as u32, distance(&state), speed(&state));
        if ends.docked {
            self.events.push(Event::Docked { deputy, speed });
        }
        if ends.crash {
            self.events.push(Event::Crashed { deputy, speed, limit: speed_limit(distance) });
        }
        if ends.out_of_bounds {
            self.events.push(Event::OutOfBounds { deputy, distance });
        }
        if ends.saturated {
            self.events.push(Event::Saturated { deputy, sum: velocity_sum });
        }
        if ends.timeout && !ends.docked {
            self.events.push(Event::TimedOut { deputy, distance });
        }
    }

    /// Among deputies that have not left, also not in this step: two too close end the episode for all of them.
    fn collide(&mut self) {
        let mut collided = false;
        for i in 0..self.count {
            for j in i + 1..self.count {
                let (a, b) = (&self.deputies[i], &self.deputies[j]);
                if !(a.flies() && b.flies()) {
                    continue;
                }
                let apart = separation(&a.state, &b.state);
                if apart < COLLISION_DISTANCE_M {
                    collided = true;
                    let (first, second) = (i as u32, j as u32);
                    self.events.push(Event::Collided { first, second, separation: apart });
                }
            }
        }
        if collided {
            for deputy in self.deputies[..self.count].iter_mut().filter(|deputy| deputy.flies()) {
                deputy.ends.collision = true;
            }
        }
    }

    /// Writes the observations of all deputies, 8 values each and in order, into the caller's buffer: position/100 m,
    /// velocity/0.5 m/s, speed m/s, speed limit m/s. A deputy that has left shows its last observation. What does not
    /// fit is left out, what is left of the buffer is zeroed.
    pub fn observe_into(&self, out: &mut [f32]) {
        let mut rows = out.chunks_mut(OBSERVATION);
        for deputy in self.deputies() {
            let Some(row) = rows.next() else { return };
            let seen = observe(&deputy.state);
            row.copy_from_slice(&seen[..row.len()]);
        }
        rows.for_each(|row| row.fill(0.0));
    }

    /// Which deputies fly.
    #[must_use]
    pub fn live(&self) -> [bool; MAX_DEPUTIES] {
        std::array::from_fn(|i| i < self.count && self.deputies[i].flies())
    }

    /// The deputies; those that have left stay as they left.
    #[must_use]
    pub fn deputies(&self) -> &[Deputy] {
        &self.deputies[..self.count]
    }

    /// What became of a deputy.
    #[must_use]
    pub fn status(&self, deputy: usize) -> Status {
        self.deputies[deputy].ends.status()
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

    /// The sum of the team's rewards.
    #[must_use]
    pub const fn total(&self) -> f64 {
        self.total
    }

    /// The recipe in docking's terms.
    #[must_use]
    pub const fn setup(&self) -> &Setup {
        &self.setup
    }

    /// A digest of every bit of the state.
    #[must_use]
    pub fn state_hash(&self) -> [u8; 32] {
        let mut state = StateHasher::new();
        let mut put = |value| state.put(value);
        for deputy in self.deputies() {
            deputy.state.iter().for_each(|&value| put(value));
            put(f64::from(deputy.ends.status() as u8));
            put(deputy.nearness);
            put(deputy.velocity_sum);
            put(deputy.earned);
        }
        put(f64::from(self.step));
        put(self.total);
        put(self.delta_v);
        state.finish()
    }

    /// How it went so far. The score is the mean return over the initial deputies, which is the sum of the team's
    /// rewards.
    #[must_use]
    pub fn flown(&self) -> Flown {
        let count = |wanted: fn(Status) -> bool| {
            self.deputies().iter().filter(|deputy| wanted(deputy.ends.status())).count()
        };
        let docked = count(|status| status == Status::Docked);
        let left = count(|status| status != Status::Active);
        Flown {
            score: self.total,
            total: self.total,
            steps: self.step,
            lost: (left - docked) as u32,
            goal: Some(docked as f64 / self.count as f64),
            fuel_used: self.delta_v,
        }
    }
}

/// What a deputy observes.
#[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
#[inline]
#[must_use]
pub fn observe(s: &State) -> [f32; OBSERVATION] {
    [
        (s[0] / POSITION_SCALE_M) as f32,
        (s[1] / POSITION_SCALE_M) as f32,
        (s[2] / POSITION_SCALE_M) as f32,
        (s[3] / VELOCITY_SCALE_M_S) as f32,
        (s[4] / VELOCITY_SCALE_M_S) as f32,
        (s[5] / VELOCITY_SCALE_M_S) as f32,
        speed(s) as f32,
        limit_line(distance(s)) as f32,
    ]
}
