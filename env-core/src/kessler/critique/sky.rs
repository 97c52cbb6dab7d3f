//! Where debris is after every step, since when the agents see it, and whether a path is clear of what they know.

use std::cell::OnceCell;

use super::trace::{Trace, Who};
use crate::kessler::constants::{CONTACT_2, EARTH_RADIUS_2, HORIZON, SATELLITES, SURVIVED};
use crate::kessler::flight::Satellite;
use crate::kessler::kernel::{Body, Gravity, distance_2, swept_2};
use crate::kessler::planner::table::Table;
use crate::kessler::setup::{Contact, Physics, Setup, Start};

/// Seen at no step.
const NEVER: u32 = u32::MAX;

/// All debris of an episode, and what was seen of it.
pub(super) struct Sky<'a> {
    table: &'a Table,
    trace: &'a Trace,
    physics: Physics,
    radar_range: Option<f64>,
    /// The step in which each column of the table arrives; 0 for debris of the start.
    arrivals: Vec<u32>,
    /// The first step after which each column is seen.
    seen: OnceCell<Vec<u32>>,
}

impl<'a> Sky<'a> {
    pub(super) fn of(setup: &Setup, start: &Start, table: &'a Table, trace: &'a Trace) -> Self {
        let mut arrivals = vec![0; start.debris.len()];
        arrivals.extend(start.rogues.iter().map(|(step, _)| *step));
        let Setup { physics, radar_range, .. } = *setup;
        Self { table, trace, physics, radar_range, arrivals, seen: OnceCell::new() }
    }

    /// The first step after which a body exists.
    pub(super) fn arrival(&self, who: Who) -> u32 {
        match who {
            Who::Debris(column) | Who::Rogue(column) => self.arrivals.get(column).copied().unwrap_or(0),
            Who::Fragment(index) => self.trace.fragments.get(index).map_or(0, |f| f.born),
        }
    }

    /// Where a body is after `step`; none where it is not (yet, or any more).
    pub(super) fn place(&self, who: Who, step: u32) -> Option<(f64, f64)> {
        let since = step.checked_sub(self.arrival(who))?;
        match who {
            Who::Debris(column) | Who::Rogue(column) => Some(self.table.place(column, step as usize)),
            Who::Fragment(index) => {
                let body = self.trace.fragments.get(index)?.bodies.get(since as usize)?;
                Some((body.x, body.y))
            }
        }
    }

    /// The first step below `before` after which a body is seen by some active satellite.
    pub(super) fn first_seen(&self, who: Who, before: u32) -> Option<u32> {
        (self.arrival(who)..before).find(|&step| self.place(who, step).is_some_and(|at| self.sees(step, at)))
    }

    /// [`Flight::sees`](crate::kessler::flight::Flight::sees), after a step of the trace.
    fn sees(&self, step: u32, (x, y): (f64, f64)) -> bool {
        let near =
            |s: &Satellite, range: f64| s.active() && distance_2(s.body.x, s.body.y, x, y) <= range * range;
        self.radar_range
            .is_none_or(|range| (0..SATELLITES).any(|i| near(self.trace.satellite(i, step), range)))
    }

    /// Whether a column was seen before the burns of `step`: its orbit is known from then on.
    fn known(&self, column: usize, step: u32) -> bool {
        let seen = self.seen.get_or_init(|| {
            let steps = self.trace.flown.steps;
            (0..self.table.len())
                .map(|column| self.first_seen(Who::Debris(column), steps).unwrap_or(NEVER))
                .collect()
        });
        seen.get(column).is_some_and(|&seen| seen < step)
    }

    /// Whether a body that burns and then coasts from before the motion of `step` comes through to the end, as far as
    /// anybody can know before that step: clear of the Earth and of everything seen by then. `before` is it without the
    /// burn; under `risk: pc` its survival so far is `left`.
    pub(super) fn clear(&self, before: Body, mut body: Body, step: u32, mut left: f64) -> bool {
        let seen = |who: &Who| self.first_seen(*who, step).is_some();
        let fragments: Vec<Who> = (0..self.trace.fragments.len()).map(Who::Fragment).filter(seen).collect();
        let mut before = before;
        for t in step..=HORIZON {
            if body.radius_2() < EARTH_RADIUS_2 {
                return false;
            }
            body = body.coasted(self.physics.gravity);
            let at = t as usize;
            if let Contact::Chance(sigma) = self.physics.contact {
                self.table.passing(at, &before, &body, sigma, |column| {
                    let spares = self.table.spares(column, at, &before, &body, sigma);
                    left *= if spares < 1.0 && self.known(column, step) { spares } else { 1.0 };
                });
                if left < SURVIVED {
                    return false;
                }
            }
            let known = |i: usize| self.table.meets(i, at, &body) && self.known(i, step);
            if self.table.destroyed(at, &body) && (0..self.table.len()).any(known) {
                return false;
            }
            if fragments.iter().any(|&who| self.meets(who, t, &body)) {
                return false;
            }
            before = body;
        }
        true
    }

    /// Whether this one piece of debris destroys a body in `step`, at whose end it is there.
    fn meets(&self, who: Who, step: u32, body: &Body) -> bool {
        let Who::Fragment(index) = who else { return false };
        let Some(fragment) = self.trace.fragments.get(index) else { return false };
        let Some(since) = step.checked_sub(fragment.born) else { return false };
        let Some(piece) = fragment.bodies.get(since as usize) else { return false };
        let (dx, dy) = (body.x - piece.x, body.y - piece.y);
        let d2 = if self.physics.contact == Contact::Swept && since > 0 {
            swept_2(dx, dy, body.vx - piece.vx, body.vy - piece.vy)
        } else {
            dx * dx + dy * dy
        };
        d2 < CONTACT_2
    }

    /// The probability that one piece of debris does not hit a body in `step`, which was at `before` and is at `body`: 0
    /// or 1 where it destroys what it touches.
    pub(super) fn spares(&self, who: Who, step: u32, before: &Body, body: &Body) -> f64 {
        let destroyed = match (who, self.physics.contact) {
            (Who::Debris(column) | Who::Rogue(column), Contact::Chance(sigma)) => {
                return self.table.spares(column, step as usize, before, body, sigma);
            }
            (Who::Debris(column) | Who::Rogue(column), _) => self.table.meets(column, step as usize, body),
            (Who::Fragment(_), _) => self.meets(who, step, body),
        };
        if destroyed { 0.0 } else { 1.0 }
    }

    /// What pulls.
    pub(super) fn gravity(&self) -> Gravity {
        self.physics.gravity
    }
}
