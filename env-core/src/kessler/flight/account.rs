//! What can be read of an episode at any time.

use super::{Flight, Satellite};
use crate::bracket::Flown;
use crate::canonical::StateHasher;
use crate::chance::Chance;
use crate::kessler::constants::SATELLITES;
use crate::kessler::debris::Debris;
use crate::kessler::event::Event;
use crate::kessler::kernel::{Body, distance_2};
use crate::kessler::reward::{Objective, score};
use crate::kessler::setup::Setup;

impl<C: Chance> Flight<C> {
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
        put(self.total);
        put(self.goal_sum);
        state.finish()
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
