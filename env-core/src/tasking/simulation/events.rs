//! Events that end a step.

use super::TaskingSim;
use super::agent::Agent;
use crate::tasking::clock::TickLength;
use crate::tasking::error::TaskingError;
use crate::tasking::setup::actions::UNLIMITED_S;

/// Tolerances with which BSK-RL compares the time of a timed event with the close of a window (`numpy.isclose`).
const CLOSE_ABSOLUTE_S: f64 = 1e-9;
const CLOSE_RELATIVE: f64 = 1e-5;

impl TaskingSim {
    /// Begins the ticks of a step. Returns true if an event ends it before the first one.
    ///
    /// # Errors
    /// Returns [`TaskingError::EndlessStep`] if nothing can end the step.
    pub(super) fn begin_ticks(&mut self) -> Result<bool, TaskingError> {
        let tick = self.setup.clock.tick;
        self.step_start = self.now;
        let max_step_s = self.setup.clock.max_step_s;
        let is_limited = max_step_s < UNLIMITED_S;
        self.step_limit = is_limited.then(|| tick.first_tick_at(self.time_s() + max_step_s)).flatten();
        if self.process_events() {
            return Ok(true);
        }
        if !self.can_end() {
            return Err(TaskingError::EndlessStep);
        }
        Ok(false)
    }

    /// True if anything can end the step: a limit, or an event or image of a satellite that ends steps.
    fn can_end(&self) -> bool {
        let has_event = |agent: &Agent| {
            let event = agent.timed_event.and_then(|event| event.tick);
            agent.setup.variable_interval && (event.is_some() || agent.satellite.awaited_bits.is_some())
        };
        self.step_limit.is_some() || self.time_limit.is_some() || self.agents.iter().any(has_event)
    }

    /// The next tick at which a timed event is due.
    pub(super) fn next_event(&self) -> Option<u64> {
        let timed = self.agents.iter().filter_map(|agent| agent.timed_event.and_then(|event| event.tick));
        timed.chain(self.step_limit).chain(self.time_limit).min()
    }

    /// Processes all events that are due. Returns true if one ends the step.
    pub(super) fn process_events(&mut self) -> bool {
        let (now, tick) = (self.now, self.setup.clock.tick);
        // Basilisk stops at the time limit before it looks at the events of that time.
        if self.time_limit.is_some_and(|limit| now >= limit) {
            return true;
        }
        let mut is_ended = self.step_limit.is_some_and(|limit| now >= limit);
        for agent in &mut self.agents {
            let has_image =
                agent.satellite.awaited_bits.is_some_and(|bits| agent.satellite.state.stored > bits);
            if has_image {
                agent.satellite.awaited_bits = None;
                agent.images += 1;
                agent.needs_action = true;
                is_ended |= agent.setup.variable_interval;
            }
            let due = agent.timed_event.filter(|event| event.tick.is_some_and(|due| now >= due));
            if let Some(event) = due {
                agent.timed_event = None;
                agent.needs_action = true;
                agent.misses +=
                    u32::from(event.window_close_s.is_some_and(|close| is_close(tick, now, close)));
                is_ended |= agent.setup.variable_interval;
            }
        }
        is_ended
    }
}

/// True if a tick is at the close of a window, within BSK-RL's tolerances.
fn is_close(tick: TickLength, now: u64, close_s: f64) -> bool {
    (tick.time_s(now) - close_s).abs() <= CLOSE_ABSOLUTE_S + CLOSE_RELATIVE * close_s.abs()
}
