//! Copies of an episode that try actions: they share what does not change, and take over the state of the original again and again.

use super::TaskingSim;
use super::agent::Agent;

impl TaskingSim {
    /// Takes over the state of another copy of the same episode, without orbits, windows and set-up, which both have.
    pub(crate) fn copy_state_from(&mut self, other: &Self) {
        for (agent, other) in self.agents.iter_mut().zip(&other.agents) {
            agent.copy_state_from(other);
        }
        self.now = other.now;
        self.step_start = other.step_start;
        self.step_limit = other.step_limit;
        self.rewarded.clone_from(&other.rewarded);
        self.last_communication_s = other.last_communication_s;
        self.totals.clone_from(&other.totals);
        self.steps = other.steps;
    }

    /// A copy of the episode with one of its satellites only, and with the time limit.
    pub(crate) fn only(&self, index: usize) -> Self {
        Self { time_limit: self.time_limit, ..self.single(index) }
    }
}

impl Agent {
    fn copy_state_from(&mut self, other: &Self) {
        self.satellite.copy_state_from(&other.satellite);
        self.imaged.clone_from(&other.imaged);
        self.last_action = other.last_action;
        self.timed_event = other.timed_event;
        self.broadcast_pending = other.broadcast_pending;
        self.needs_action = other.needs_action;
        self.latest_target = other.latest_target;
        self.images = other.images;
        self.misses = other.misses;
        self.is_alive = other.is_alive;
        self.logged_bits = other.logged_bits;
        self.elements = other.elements;
        self.logged_resources.clone_from(&other.logged_resources);
    }
}
