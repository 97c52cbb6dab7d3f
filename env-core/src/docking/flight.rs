//! One episode of docking, step by step, in the order that is part of the contract: thrust and motion of every deputy,
//! ends of each by itself, collisions among those left, rewards.

use serde::Serialize;

use super::constants::{
    COLLISION_DISTANCE_M, DOCKING_RADIUS_M, MAX_DEPUTIES, MAX_DISTANCE_M, OBSERVATION, POSITION_SCALE_M,
    SATURATION, STEP_S, VELOCITY_SCALE_M_S,
};
use super::event::Event;
use super::relative::{State, Step, distance, limit_line, separation, speed, speed_limit};
use super::reward::{FAILED, Reward, approach, delta_v, docking, nearness, thrusting, violation};
use super::setup::{Setup, Start};
use crate::bracket::Flown;
use crate::error::StepError;
use crate::log::{JointAction, MAX_ENTRIES};

/// Thrusts of all deputies over one step, N per axis.
pub type Thrusts = [[f64; 3]; MAX_DEPUTIES];

/// What became of a deputy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
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
    deputies: usize,
    states: [State; MAX_DEPUTIES],
    ends: [Ends; MAX_DEPUTIES],
    nearness: [f64; MAX_DEPUTIES],
    velocity_sum: [f64; MAX_DEPUTIES],
    returns: [f64; MAX_DEPUTIES],
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
            deputies: 0,
            states: [[0.0; 6]; MAX_DEPUTIES],
            ends: [Ends::default(); MAX_DEPUTIES],
            nearness: [0.0; MAX_DEPUTIES],
            velocity_sum: [0.0; MAX_DEPUTIES],
            returns: [0.0; MAX_DEPUTIES],
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
        self.deputies = start.deputies.clamp(1, MAX_DEPUTIES);
        self.states = start.states;
        self.ends = [Ends::default(); MAX_DEPUTIES];
        self.nearness = [0.0; MAX_DEPUTIES];
        self.velocity_sum = [0.0; MAX_DEPUTIES];
        self.returns = [0.0; MAX_DEPUTIES];
        self.step = 0;
        self.total = 0.0;
        self.delta_v = 0.0;
        self.done = false;
        self.events.clear();
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
        let entries = action.agents.len();
        if entries > MAX_ENTRIES {
            return Err(StepError::TooMany { count: entries, max: MAX_ENTRIES });
        }
        if action.values.len() != 3 * entries {
            return Err(StepError::Shape { values: action.values.len(), entries, dim: 3 });
        }
        for (&agent, values) in action.agents.iter().zip(action.values.chunks_exact(3)) {
            if agent as usize >= self.deputies {
                return Err(StepError::UnknownAgent { agent, last: self.deputies as u32 - 1 });
            }
            if !values.iter().all(|v| v.is_finite()) {
                return Err(StepError::NotFinite { agent });
            }
        }
        Ok(())
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
        for (i, thrust) in thrusts.into_iter().enumerate() {
            if stepped.live_before[i] {
                stepped.rewards[i] = self.move_one(i, thrust);
            }
        }
        if self.deputies > 1 {
            self.collide();
        }
        let mut sum = 0.0;
        for i in 0..self.deputies {
            let reward = stepped.rewards[i].total();
            self.returns[i] += reward;
            sum += reward;
        }
        stepped.reward = sum / self.deputies as f64;
        self.total += stepped.reward;
        self.done = (0..self.deputies).all(|i| self.ends[i].any());
        stepped.done = self.done;
        stepped
    }

    /// Thrust, motion, ends and reward of one deputy.
    #[inline]
    fn move_one(&mut self, i: usize, thrust: [f64; 3]) -> Reward {
        let bound = self.setup.thrust_bound;
        let thrust = thrust.map(|axis| axis.clamp(-bound, bound));
        let state = self.law.advance(&self.states[i], thrust);
        self.states[i] = state;
        let (d, v) = (distance(&state), speed(&state));
        let limit = speed_limit(d);
        let time = f64::from(self.step) * STEP_S;

        let change = delta_v(thrust);
        self.delta_v += change;
        let near = nearness(d);
        let mut reward = Reward {
            distance: if self.step == 1 { 0.0 } else { approach(self.nearness[i], near) },
            delta_v: thrusting(change),
            velocity: violation(v, limit),
            ..Reward::default()
        };
        self.nearness[i] = near;
        self.velocity_sum[i] += reward.velocity;

        let inside = d <= DOCKING_RADIUS_M;
        let ends = Ends {
            timeout: self.step >= self.setup.time_limit,
            out_of_bounds: d > MAX_DISTANCE_M,
            crash: inside && v > limit,
            docked: inside && v <= limit,
            saturated: self.velocity_sum[i] <= SATURATION,
            collision: false,
        };
        if ends.any() {
            self.ends[i] = ends;
            if ends.docked {
                reward.success = docking(time, f64::from(self.setup.time_limit) * STEP_S);
            }
            if ends.timeout || ends.out_of_bounds || ends.crash {
                reward.failure = FAILED;
            }
            self.tell(i, ends, d, v, limit);
        }
        reward
    }

    /// The events of a deputy that leaves.
    #[cold]
    fn tell(&mut self, i: usize, ends: Ends, distance: f64, speed: f64, limit: f64) {
        let deputy = i as u32;
        if ends.docked {
            self.events.push(Event::Docked { deputy, speed });
        }
        if ends.crash {
            self.events.push(Event::Crashed { deputy, speed, limit });
        }
        if ends.out_of_bounds {
            self.events.push(Event::OutOfBounds { deputy, distance });
        }
        if ends.saturated {
            self.events.push(Event::Saturated { deputy, sum: self.velocity_sum[i] });
        }
        if ends.timeout && !ends.docked {
            self.events.push(Event::TimedOut { deputy, distance });
        }
    }

    /// Among deputies that have not left, also not in this step: two too close end the episode for all of them.
    fn collide(&mut self) {
        let mut collided = false;
        for i in 0..self.deputies {
            for j in i + 1..self.deputies {
                if self.ends[i].any() || self.ends[j].any() {
                    continue;
                }
                let apart = separation(&self.states[i], &self.states[j]);
                if apart < COLLISION_DISTANCE_M {
                    collided = true;
                    let (first, second) = (i as u32, j as u32);
                    self.events.push(Event::Collided { first, second, separation: apart });
                }
            }
        }
        if collided {
            for ends in self.ends[..self.deputies].iter_mut().filter(|ends| !ends.any()) {
                ends.collision = true;
            }
        }
    }

    /// Writes the observations of all deputies, 8 values each and in order, into the caller's buffer: position/100 m,
    /// velocity/0.5 m/s, speed m/s, speed limit m/s. A deputy that has left shows its last observation. What does not
    /// fit is left out, what is left of the buffer is zeroed.
    pub fn observe_into(&self, out: &mut [f32]) {
        let mut rows = out.chunks_mut(OBSERVATION);
        for state in &self.states[..self.deputies] {
            let Some(row) = rows.next() else { return };
            let seen = observe(state);
            row.copy_from_slice(&seen[..row.len()]);
        }
        rows.for_each(|row| row.fill(0.0));
    }

    /// Which deputies fly.
    #[must_use]
    pub fn live(&self) -> [bool; MAX_DEPUTIES] {
        std::array::from_fn(|i| i < self.deputies && !self.ends[i].any())
    }

    /// Deputies at the start.
    #[must_use]
    pub const fn deputies(&self) -> usize {
        self.deputies
    }

    /// Positions and velocities; those of deputies that have left stay where they left.
    #[must_use]
    pub fn states(&self) -> &[State] {
        &self.states[..self.deputies]
    }

    /// By which rules a deputy has left.
    #[must_use]
    pub const fn ends(&self, deputy: usize) -> Ends {
        self.ends[deputy]
    }

    /// What became of a deputy.
    #[must_use]
    pub const fn status(&self, deputy: usize) -> Status {
        self.ends[deputy].status()
    }

    /// The rewards of each deputy so far, added up.
    #[must_use]
    pub fn returns(&self) -> &[f64] {
        &self.returns[..self.deputies]
    }

    /// The velocity rewards of each deputy so far, added up.
    #[must_use]
    pub fn velocity_sums(&self) -> &[f64] {
        &self.velocity_sum[..self.deputies]
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
        let mut hasher = blake3::Hasher::new();
        let mut put = |value: f64| {
            hasher.update(&value.to_bits().to_le_bytes());
        };
        for i in 0..self.deputies {
            self.states[i].iter().for_each(|&value| put(value));
            put(f64::from(self.ends[i].status() as u8));
            put(self.nearness[i]);
            put(self.velocity_sum[i]);
            put(self.returns[i]);
        }
        put(f64::from(self.step));
        put(self.total);
        put(self.delta_v);
        *hasher.finalize().as_bytes()
    }

    /// How it went so far. The score is the mean return over the initial deputies, which is the sum of the team's
    /// rewards.
    #[must_use]
    pub fn flown(&self) -> Flown {
        let count = |wanted: fn(Status) -> bool| {
            self.ends[..self.deputies].iter().filter(|ends| wanted(ends.status())).count()
        };
        let docked = count(|status| status == Status::Docked);
        let left = count(|status| status != Status::Active);
        Flown {
            score: self.total,
            total: self.total,
            steps: self.step,
            lost: (left - docked) as u32,
            goal: Some(docked as f64 / self.deputies as f64),
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
