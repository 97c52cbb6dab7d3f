//! Policies that look at nothing, or follow a plan.

use super::Pilot;
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::planner::panel::{Direction, capped};
use crate::kessler::telemetry::Telemetry;
use crate::log::ActionLog;
use crate::seed::Seed;

/// Does nothing.
pub(super) struct Hold;

impl Pilot for Hold {
    fn fly(&mut self, _: &Telemetry, _: &mut ActionLog) {}
}

/// Burns at random on every axis, every step.
pub(super) struct Random(Seeded);

impl Random {
    pub(super) fn new(seed: Seed) -> Self {
        Self(Seeded::new(seed))
    }
}

impl Pilot for Random {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        for s in &seen.satellites {
            let burn = [self.0.between(Stream::Policy, -1.0, 1.0), self.0.between(Stream::Policy, -1.0, 1.0)];
            if s.active() {
                log.act(s.id, &burn);
            }
        }
    }
}

/// One radial kick of 0.2 LU/TU at step 0, whatever is out there.
pub(super) struct Blind {
    kicked: bool,
}

impl Blind {
    pub(super) const fn new() -> Self {
        Self { kicked: false }
    }
}

/// The fixed kick's size, LU/TU.
const KICK: f64 = 0.2;

impl Pilot for Blind {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        if std::mem::replace(&mut self.kicked, true) {
            return;
        }
        for s in seen.satellites.iter().filter(|s| s.active()) {
            let (x, y) = Direction::RadialOut.of(&s.body());
            let size = capped(KICK, s.fuel);
            log.act(s.id, &[size * x, size * y]);
        }
    }
}

/// Follows a plan step by step.
pub(super) struct Witness {
    plan: ActionLog,
    step: usize,
}

impl Witness {
    pub(super) const fn new(plan: ActionLog) -> Self {
        Self { plan, step: 0 }
    }
}

impl Pilot for Witness {
    fn fly(&mut self, _: &Telemetry, log: &mut ActionLog) {
        let action = self.plan.step(self.step);
        self.step += 1;
        for (i, &agent) in action.agents.iter().enumerate() {
            log.act(agent, &action.values[2 * i..2 * i + 2]);
        }
    }
}
