//! Events that end a step.

use super::TaskingSim;
use super::agent::Agent;
use super::journal::SatelliteEvent;
use crate::tasking::clock::TickLength;
use crate::tasking::error::TaskingError;
use crate::tasking::setup::actions::UNLIMITED_S;
use crate::tasking::setup::environment::MAX_TIME_S;

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

    /// True if something ends the step within [`MAX_TIME_S`]: a limit, or the event of a satellite that ends steps. An awaited image
    /// has such an event, the close of its window.
    fn can_end(&self) -> bool {
        let events = self.agents.iter().filter(|agent| agent.setup.variable_interval);
        let ticks = events.filter_map(|agent| agent.timed_event.and_then(|event| event.tick));
        let first = ticks.chain(self.step_limit).chain(self.time_limit).min();
        let tick = self.setup.clock.tick;
        first.is_some_and(|first| tick.time_s(first) - tick.time_s(self.now) <= MAX_TIME_S)
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
                agent.note(tick.time_s(now), |target| SatelliteEvent::Imaged { target });
                agent.needs_action = true;
                is_ended |= agent.setup.variable_interval;
            }
            let due = agent.timed_event.filter(|event| event.tick.is_some_and(|due| now >= due));
            if let Some(event) = due {
                agent.timed_event = None;
                agent.needs_action = true;
                let is_missed = event.window_close_s.is_some_and(|close| is_close(tick, now, close));
                agent.misses += u32::from(is_missed);
                agent.note(tick.time_s(now), |target| {
                    if is_missed { SatelliteEvent::Missed { target } } else { SatelliteEvent::TimeUp }
                });
                is_ended |= agent.setup.variable_interval;
            }
        }
        is_ended
    }
}

impl Agent {
    /// Adds to the journal what happened at a time, s, given the target of the last command to image.
    fn note(&mut self, time_s: f64, event: impl FnOnce(Option<usize>) -> SatelliteEvent) {
        if let Some(journal) = &mut self.journal {
            journal.add(time_s, event(self.latest_target));
        }
    }
}

/// True if a tick is at the close of a window, within BSK-RL's tolerances.
fn is_close(tick: TickLength, now: u64, close_s: f64) -> bool {
    (tick.time_s(now) - close_s).abs() <= CLOSE_ABSOLUTE_S + CLOSE_RELATIVE * close_s.abs()
}
