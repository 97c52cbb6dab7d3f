//! Simulation of one episode.
//!
//! The order of a step is part of the contract: thrust and motion of every deputy, end conditions of each by itself,
//! collisions among the remaining deputies, rewards.

use super::constants::{
    COLLISION_DISTANCE_M, EXTENDED_DIM, MAX_DEPUTIES, OBSERVATION_DIM, POSITION_SCALE_M, STEP_S,
    TIME_SCALE_S, VELOCITY_SCALE_M_S,
};
use super::deputy::Deputy;
use super::end_conditions::DeputyStatus;
use super::event::DockingEvent;
use super::relative_motion::{
    RelativeState, StepTransition, distance, extended_speed_limit, separation, speed, speed_limit,
};
use super::reward::DockingReward;
use super::setup::{DeputyStarts, DockingSetup};
use crate::bracket::EpisodeOutcome;
use crate::canonical::StateHasher;
use crate::error::StepError;
use crate::log::JointAction;

/// Thrusts of all deputies in one step, N per axis.
pub type Thrusts = [[f64; 3]; MAX_DEPUTIES];

/// Result of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DockingStep {
    /// True for each deputy that was active before the step.
    pub active_before: [bool; MAX_DEPUTIES],
    /// Rewards of the deputies; zero for those that were not active.
    pub rewards: [DockingReward; MAX_DEPUTIES],
    /// Reward of the team: the mean over the initial deputies.
    pub reward: f64,
    /// True if the episode is over.
    pub done: bool,
}

/// State of one episode.
#[derive(Debug, Clone)]
pub struct DockingSim {
    setup: DockingSetup,
    transition: &'static StepTransition,
    deputy_count: usize,
    deputies: [Deputy; MAX_DEPUTIES],
    step: u32,
    total: f64,
    delta_v: f64,
    done: bool,
    events: Vec<DockingEvent>,
}

/// Largest number of events in one step: four end conditions of each deputy, and every pair.
const MAX_EVENTS: usize = 4 * MAX_DEPUTIES + MAX_DEPUTIES * (MAX_DEPUTIES - 1) / 2;

impl DockingSim {
    /// Creates an episode at its start.
    #[must_use]
    pub fn new(setup: DockingSetup, start: &DeputyStarts) -> Self {
        let mut sim = Self {
            setup,
            transition: StepTransition::world_step(),
            deputy_count: 0,
            deputies: [Deputy::default(); MAX_DEPUTIES],
            step: 0,
            total: 0.0,
            delta_v: 0.0,
            done: false,
            events: Vec::with_capacity(MAX_EVENTS),
        };
        sim.reset(start);
        sim
    }

    /// Starts a new episode in the same memory.
    pub fn reset(&mut self, start: &DeputyStarts) {
        self.setup.time_limit = start.time_limit;
        self.deputy_count = start.deputies.clamp(1, MAX_DEPUTIES);
        self.deputies = start.states.map(Deputy::new);
        self.step = 0;
        self.total = 0.0;
        self.delta_v = 0.0;
        self.done = false;
        self.events.clear();
    }

    /// Sets the recipe of the next episode.
    pub(super) const fn set_setup(&mut self, setup: DockingSetup) {
        self.setup = setup;
    }

    /// Memory of the simulation, in bytes.
    #[must_use]
    pub fn memory_bytes(&self) -> usize {
        size_of::<Self>() + self.events.capacity() * size_of::<DockingEvent>()
    }

    /// Advances the episode by one step. An entry of the action is a thrust on x, y, z in N, held for the step; a deputy
    /// without one coasts. Thrusts of one deputy are added, then each axis is clamped. Those of deputies that have left
    /// are ignored.
    ///
    /// # Errors
    /// Returns [`StepError::Ended`] after the end, and the error of the action's check if it is invalid. Nothing changes
    /// then.
    pub fn step(&mut self, action: JointAction<'_>) -> Result<DockingStep, StepError> {
        self.check(action)?;
        let mut thrusts = [[0.0; 3]; MAX_DEPUTIES];
        for (i, &agent) in action.agents.iter().enumerate() {
            let sum = &mut thrusts[agent as usize];
            for (axis, total) in sum.iter_mut().enumerate() {
                *total += action.values[3 * i + axis];
            }
        }
        Ok(self.apply_thrusts(thrusts))
    }

    fn check(&self, action: JointAction<'_>) -> Result<(), StepError> {
        if self.done {
            return Err(StepError::Ended { step: self.step });
        }
        action.check(3, Some(self.deputy_count))
    }

    /// Advances the episode by one step under finite thrusts of any size; each axis is clamped. After the end it does
    /// nothing. The batch engine calls it directly.
    pub fn apply_thrusts(&mut self, thrusts: Thrusts) -> DockingStep {
        let mut result = DockingStep {
            active_before: self.active_deputies(),
            rewards: [DockingReward::default(); MAX_DEPUTIES],
            reward: 0.0,
            done: self.done,
        };
        if self.done {
            return result;
        }
        self.step += 1;
        self.events.clear();
        let mut sum = 0.0;
        for (i, thrust) in thrusts.into_iter().enumerate() {
            if result.active_before[i] {
                let step = self.deputies[i].step(self.transition, &self.setup, self.step, thrust);
                result.rewards[i] = step.reward;
                self.delta_v += step.delta_v;
                sum += step.reward.total();
                if !self.deputies[i].is_active() {
                    self.push_end_events(i);
                }
            }
        }
        if self.deputy_count > 1 {
            self.apply_collisions();
        }
        result.reward = sum / self.deputy_count as f64;
        self.total += result.reward;
        self.done = !self.deputies().iter().any(Deputy::is_active);
        result.done = self.done;
        result
    }

    /// Records the events of a deputy that leaves.
    #[cold]
    fn push_end_events(&mut self, i: usize) {
        let Deputy { state, velocity_penalty: velocity_sum, end_conditions: ends, .. } = self.deputies[i];
        let (deputy, distance, speed) = (i as u32, distance(&state), speed(&state));
        if ends.docked {
            self.events.push(DockingEvent::Docked { deputy, speed });
        }
        if ends.crash {
            self.events.push(DockingEvent::Crashed { deputy, speed, limit: speed_limit(distance) });
        }
        if ends.out_of_bounds {
            self.events.push(DockingEvent::OutOfBounds { deputy, distance });
        }
        if ends.saturated {
            self.events.push(DockingEvent::Saturated { deputy, sum: velocity_sum });
        }
        if ends.timeout && !ends.docked {
            self.events.push(DockingEvent::TimedOut { deputy, distance });
        }
    }

    /// Ends the episode for all active deputies if two of them collide. Deputies that left in this step do not count.
    fn apply_collisions(&mut self) {
        let mut collided = false;
        for i in 0..self.deputy_count {
            for j in i + 1..self.deputy_count {
                let (a, b) = (&self.deputies[i], &self.deputies[j]);
                if !(a.is_active() && b.is_active()) {
                    continue;
                }
                let apart = separation(&a.state, &b.state);
                if apart < COLLISION_DISTANCE_M {
                    collided = true;
                    let (first, second) = (i as u32, j as u32);
                    self.events.push(DockingEvent::Collided { first, second, separation: apart });
                }
            }
        }
        if collided {
            for deputy in self.deputies[..self.deputy_count].iter_mut().filter(|deputy| deputy.is_active()) {
                deputy.end_conditions.collision = true;
            }
        }
    }

    /// Writes the observations of all deputies in order, 8 values each (see [`observe_deputy`]). A deputy that has left
    /// keeps its last observation. Values beyond the buffer are dropped; the rest of the buffer is zeroed.
    pub fn observe_into(&self, out: &mut [f32]) {
        let mut rows = out.chunks_mut(OBSERVATION_DIM);
        for deputy in self.deputies() {
            let Some(row) = rows.next() else { return };
            let observation = observe_deputy(&deputy.state);
            row.copy_from_slice(&observation[..row.len()]);
        }
        rows.for_each(|row| row.fill(0.0));
    }

    /// Writes the extended observations of all deputies in order, see [`observe_extended`]. The rest of the buffer is zeroed.
    pub fn observe_extended_into(&self, out: &mut [f32]) {
        let limit = f64::from(self.setup.time_limit) * STEP_S;
        let left = limit - f64::from(self.step) * STEP_S;
        let mut rows = out.chunks_exact_mut(EXTENDED_DIM);
        for (deputy, row) in self.deputies().iter().zip(&mut rows) {
            row.copy_from_slice(&observe_extended(&deputy.state, [left, limit], self.setup.thrust_bound));
        }
        rows.for_each(|row| row.fill(0.0));
    }

    /// True for each deputy that is active.
    #[must_use]
    pub fn active_deputies(&self) -> [bool; MAX_DEPUTIES] {
        std::array::from_fn(|i| i < self.deputy_count && self.deputies[i].is_active())
    }

    /// The deputies; those that have left keep their last state.
    #[must_use]
    pub fn deputies(&self) -> &[Deputy] {
        &self.deputies[..self.deputy_count]
    }

    /// Status of a deputy.
    #[must_use]
    pub fn status(&self, deputy: usize) -> DeputyStatus {
        self.deputies[deputy].end_conditions.status()
    }

    /// Events of the last step.
    #[must_use]
    pub fn events(&self) -> &[DockingEvent] {
        &self.events
    }

    /// Number of steps taken.
    #[must_use]
    pub const fn steps(&self) -> u32 {
        self.step
    }

    /// True if the episode is over.
    #[must_use]
    pub const fn is_done(&self) -> bool {
        self.done
    }

    /// Sum of the team's rewards.
    #[must_use]
    pub const fn total(&self) -> f64 {
        self.total
    }

    /// The parameters of the episode.
    #[must_use]
    pub const fn setup(&self) -> &DockingSetup {
        &self.setup
    }

    /// A digest of every bit of the state.
    #[must_use]
    pub fn state_hash(&self) -> [u8; 32] {
        let mut state = StateHasher::new();
        let mut put = |value| state.put(value);
        for deputy in self.deputies() {
            deputy.state.iter().for_each(|&value| put(value));
            put(f64::from(deputy.end_conditions.status() as u8));
            put(deputy.proximity);
            put(deputy.velocity_penalty);
            put(deputy.total_reward);
        }
        put(f64::from(self.step));
        put(self.total);
        put(self.delta_v);
        state.finish()
    }

    /// The outcome so far. The score is the mean return over the initial deputies, which equals the sum of the team's
    /// rewards.
    #[must_use]
    pub fn outcome(&self) -> EpisodeOutcome {
        let count = |matches: fn(DeputyStatus) -> bool| {
            self.deputies().iter().filter(|deputy| matches(deputy.end_conditions.status())).count()
        };
        let docked = count(|status| status == DeputyStatus::Docked);
        let left = count(|status| status != DeputyStatus::Active);
        EpisodeOutcome {
            score: self.total,
            total_reward: self.total,
            steps: self.step,
            lost: (left - docked) as u32,
            goal: Some(docked as f64 / self.deputy_count as f64),
            fuel_used: self.delta_v,
            time_s: None,
        }
    }
}

/// Observation of a deputy: position/100 m, velocity/0.5 m/s, speed in m/s, speed limit in m/s.
#[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
#[inline]
#[must_use]
pub fn observe_deputy(s: &RelativeState) -> [f32; OBSERVATION_DIM] {
    [
        (s[0] / POSITION_SCALE_M) as f32,
        (s[1] / POSITION_SCALE_M) as f32,
        (s[2] / POSITION_SCALE_M) as f32,
        (s[3] / VELOCITY_SCALE_M_S) as f32,
        (s[4] / VELOCITY_SCALE_M_S) as f32,
        (s[5] / VELOCITY_SCALE_M_S) as f32,
        speed(s) as f32,
        extended_speed_limit(distance(s)) as f32,
    ]
}

/// Extended observation of a deputy: that of [`observe_deputy`], then values that stay of order one near the chief.
///
/// These are the time that is left, s/500, and as a share of the time limit; ½ ln(thrust bound/N); ½ ln(distance/m) − 1; the direction
/// from the chief, a unit vector; the velocity divided by twice the speed limit, its norm, and its part along that direction.
/// `[left, time limit]` are in s.
#[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
#[must_use]
pub fn observe_extended(
    s: &RelativeState,
    [left_s, limit_s]: [f64; 2],
    thrust_bound_n: f64,
) -> [f32; EXTENDED_DIM] {
    // At the chief neither logarithm nor direction is defined; the docking radius is far above this.
    let d = distance(s).max(1e-3);
    let limit = 2.0 * speed_limit(d);
    let direction = [s[0] / d, s[1] / d, s[2] / d];
    let velocity = [s[3] / limit, s[4] / limit, s[5] / limit];
    let along = direction[0] * velocity[0] + direction[1] * velocity[1] + direction[2] * velocity[2];
    let further = [
        left_s / TIME_SCALE_S,
        left_s / limit_s,
        0.5 * libm::log(thrust_bound_n),
        0.5 * libm::log(d) - 1.0,
        direction[0],
        direction[1],
        direction[2],
        velocity[0],
        velocity[1],
        velocity[2],
        speed(s) / limit,
        along,
    ];
    let mut row = [0.0; EXTENDED_DIM];
    row[..OBSERVATION_DIM].copy_from_slice(&observe_deputy(s));
    row[OBSERVATION_DIM..].iter_mut().zip(further).for_each(|(value, further)| *value = further as f32);
    row
}
