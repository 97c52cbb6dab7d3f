//! Episodes that branch off another one, to find out what other actions would have led to.

use super::TaskingSim;
use super::agent::TimedEvent;
use crate::tasking::clock::TickLength;

impl TaskingSim {
    /// Length of a tick.
    #[must_use]
    pub fn tick_length(&self) -> TickLength {
        self.setup.clock.tick
    }

    /// Lets a satellite go on with its current task until a tick, after which it needs an action.
    pub fn go_on_until(&mut self, index: usize, tick: u64) {
        let agent = &mut self.agents[index];
        agent.needs_action = false;
        agent.timed_event = Some(TimedEvent { tick: Some(tick), window_close_s: None });
    }

    /// Ends the episode at a tick, unless its time limit is earlier. Observations keep the original limit.
    pub fn end_at(&mut self, tick: u64) {
        self.time_limit = Some(self.time_limit.map_or(tick, |limit| limit.min(tick)));
    }

    /// The same moment with one satellite alone, whose index is then 0, and without a time limit. Its motion, power and data are those
    /// that it has beside the others.
    #[must_use]
    pub fn single(&self, index: usize) -> Self {
        Self {
            agents: vec![self.agents[index].clone()],
            sky: self.sky.clone(),
            setup: self.setup.clone(),
            now: self.now,
            step_start: self.step_start,
            step_limit: self.step_limit,
            time_limit: None,
            rewarded: self.rewarded.clone(),
            last_communication_s: self.last_communication_s,
            totals: vec![self.totals[index]],
            steps: self.steps,
            found: Vec::new(),
            tolerates_missing: self.tolerates_missing,
        }
    }
}
