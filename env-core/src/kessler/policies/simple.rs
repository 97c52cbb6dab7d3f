//! Policies that hardly look.

use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::planner::panel::{Direction, capped};
use crate::kessler::telemetry::Telemetry;
use crate::log::ActionLog;
use crate::policy::Pilot;
use crate::seed::Seed;

/// Burns at random on every axis, every step.
pub(super) struct Random(Seeded);

impl Random {
    pub(super) fn new(seed: Seed) -> Self {
        Self(Seeded::new(seed))
    }
}

impl Pilot<Telemetry> for Random {
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

impl Pilot<Telemetry> for Blind {
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
