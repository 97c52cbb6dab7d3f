//! One deputy and one second of its flight: thrust, motion, ends, reward. Everything but collisions, so that engine,
//! planner and critique fly by one rule.

use super::constants::{DOCKING_RADIUS_M, FAILURE, MAX_DISTANCE_M, SATURATION, STEP_S};
use super::flight::Ends;
use super::relative::{State, Step, distance, speed, speed_limit};
use super::reward::{Reward, approach, delta_v, docking, nearness, thrusting, violation};
use super::setup::Setup;

/// One deputy in flight.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Deputy {
    /// Position, m, and velocity, m/s.
    pub state: State,
    /// How near it was after the last step.
    pub nearness: f64,
    /// Its velocity rewards, added up.
    pub velocity_sum: f64,
    /// Its rewards, added up.
    pub earned: f64,
    /// By which rules it left; none while it flies.
    pub ends: Ends,
}

/// What a second did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moved {
    /// The reward.
    pub reward: Reward,
    /// What the thrust changed the velocity by, m/s, axes added up.
    pub delta_v: f64,
}

impl Deputy {
    /// A deputy at its start.
    #[must_use]
    pub fn at(state: State) -> Self {
        Self { state, ..Self::default() }
    }

    /// Whether it flies.
    #[inline]
    #[must_use]
    pub const fn flies(&self) -> bool {
        !self.ends.any()
    }

    /// Flies step `step`, counted from 1, under a thrust in N, clamped per axis.
    #[inline]
    pub fn fly(&mut self, law: &Step, setup: &Setup, step: u32, thrust: [f64; 3]) -> Moved {
        let bound = setup.thrust_bound;
        let thrust = thrust.map(|axis| axis.clamp(-bound, bound));
        self.state = law.advance(&self.state, thrust);
        let (d, v) = (distance(&self.state), speed(&self.state));
        let limit = speed_limit(d);
        let near = nearness(d);
        let change = delta_v(thrust);
        let mut reward = Reward {
            distance: if step == 1 { 0.0 } else { approach(self.nearness, near) },
            delta_v: thrusting(change),
            velocity: violation(v, limit),
            ..Reward::default()
        };
        self.nearness = near;
        self.velocity_sum += reward.velocity;
        let inside = d <= DOCKING_RADIUS_M;
        self.ends = Ends {
            timeout: step >= setup.time_limit,
            out_of_bounds: d > MAX_DISTANCE_M,
            crash: inside && v > limit,
            docked: inside && v <= limit,
            saturated: self.velocity_sum <= SATURATION,
            collision: false,
        };
        if self.ends.docked {
            reward.success = docking(f64::from(step) * STEP_S, f64::from(setup.time_limit) * STEP_S);
        }
        if self.ends.timeout || self.ends.out_of_bounds || self.ends.crash {
            reward.failure = FAILURE;
        }
        self.earned += reward.total();
        Moved { reward, delta_v: change }
    }
}
