//! Read access to the state of an episode.

use super::{KesslerSim, Satellite};
use crate::bracket::EpisodeOutcome;
use crate::canonical::StateHasher;
use crate::episode_rng::EpisodeRng;
use crate::kessler::constants::SATELLITES;
use crate::kessler::debris::Debris;
use crate::kessler::event::KesslerEvent;
use crate::kessler::kernel::distance_squared;
use crate::kessler::reward::{Objective, score};
use crate::kessler::setup::{KesslerSetup, RogueArrival};

impl<R: EpisodeRng> KesslerSim<R> {
    /// Returns true if the radar of some active satellite reaches the point `x`, `y` (LU).
    #[must_use]
    pub fn is_visible(&self, x: f64, y: f64) -> bool {
        self.setup.radar_range.is_none_or(|range| {
            self.satellites
                .iter()
                .any(|s| s.is_active() && distance_squared(s.body.x, s.body.y, x, y) <= range * range)
        })
    }

    /// All satellites, by number.
    #[must_use]
    pub const fn satellites(&self) -> &[Satellite; SATELLITES] {
        &self.satellites
    }

    /// All debris, visible or hidden.
    #[must_use]
    pub const fn debris(&self) -> &Debris {
        &self.debris
    }

    /// Events of the last step.
    #[must_use]
    pub fn events(&self) -> &[KesslerEvent] {
        &self.events
    }

    /// Number of steps taken.
    #[must_use]
    pub const fn steps(&self) -> u32 {
        self.step
    }

    /// Returns true if the episode is over.
    #[must_use]
    pub const fn is_done(&self) -> bool {
        self.done
    }

    /// Sum of all rewards.
    #[must_use]
    pub const fn total_reward(&self) -> f64 {
        self.total_reward
    }

    /// Setup of the episode.
    #[must_use]
    pub fn setup(&self) -> &KesslerSetup {
        &self.setup
    }

    /// Objective of the task.
    #[must_use]
    pub const fn objective(&self) -> Objective {
        self.objective
    }

    /// Source of the random draws.
    #[must_use]
    pub const fn rng(&self) -> &R {
        &self.rng
    }

    /// Memory of the episode in bytes, without the setup, which may be shared.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + self.debris.bytes()
            + self.rogues.capacity() * size_of::<RogueArrival>()
            + self.events.capacity() * size_of::<KesslerEvent>()
    }

    /// Hash of every bit of the state.
    #[must_use]
    pub fn state_hash(&self) -> [u8; 32] {
        let mut state = StateHasher::new();
        let mut put = |value| state.put(value);
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
        put(self.total_reward);
        put(self.goal_sum);
        state.finish()
    }

    /// Outcome of the episode so far.
    #[must_use]
    pub fn outcome(&self) -> EpisodeOutcome {
        let lost = self.satellites.iter().filter(|s| s.is_lost()).count();
        let steps = self.objective.goal_steps();
        EpisodeOutcome {
            score: score(self.total_reward),
            total_reward: self.total_reward,
            steps: self.step,
            lost: lost as u32,
            goal: (steps > 0).then(|| self.goal_sum / f64::from(steps)),
            fuel_used: self.fuel_used,
            time_s: None,
        }
    }
}
