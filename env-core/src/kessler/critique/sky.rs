//! Where debris is after every step, since when the agents see it, and whether a path is clear of what they know.

use std::cell::OnceCell;

use super::trace::{Trace, Who};
use crate::kessler::constants::{CONTACT_2, EARTH_RADIUS_2, HORIZON, SATELLITES};
use crate::kessler::flight::Satellite;
use crate::kessler::kernel::{Body, distance_2};
use crate::kessler::planner::table::Table;
use crate::kessler::setup::{Setup, Start};

/// Seen at no step.
const NEVER: u32 = u32::MAX;

/// All debris of an episode, and what was seen of it.
pub(super) struct Sky<'a> {
    table: &'a Table,
    trace: &'a Trace,
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
        Self { table, trace, radar_range: setup.radar_range, arrivals, seen: OnceCell::new() }
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
            Who::Fragment(index) => self.trace.fragments.get(index)?.places.get(since as usize).copied(),
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

    /// Whether a body that coasts from before the motion of `step` comes through to the end, as far as anybody can know
    /// before that step: clear of the Earth and of everything seen by then.
    pub(super) fn clear(&self, mut body: Body, step: u32) -> bool {
        let fragments: Vec<Who> = (0..self.trace.fragments.len())
            .map(Who::Fragment)
            .filter(|&who| self.first_seen(who, step).is_some())
            .collect();
        for t in step..=HORIZON {
            if body.radius_2() < EARTH_RADIUS_2 {
                return false;
            }
            body = body.coasted();
            let at = t as usize;
            let column =
                |i: usize| self.table.clear_of(i, at, body.x, body.y) < CONTACT_2 && self.known(i, step);
            if self.table.touched(at, body.x, body.y) && (0..self.table.len()).any(column) {
                return false;
            }
            if fragments.iter().any(|&who| self.touches(who, t, &body)) {
                return false;
            }
        }
        true
    }

    /// Whether a body touches this debris after `step`.
    pub(super) fn touches(&self, who: Who, step: u32, body: &Body) -> bool {
        self.place(who, step).is_some_and(|(x, y)| distance_2(body.x, body.y, x, y) < CONTACT_2)
    }
}
