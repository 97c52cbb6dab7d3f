//! The list of upcoming opportunities with the semantics of BSK-RL's `AccessSatellite`.
//!
//! Opportunities are computed in blocks of time and sorted by their close; ties are in the order of insertion. A window that
//! crosses the end of the computed time is cut there, and joined with its rest when the next block is computed.
//!
//! Two faults of BSK-RL's search are kept, since its observations and actions depend on them: a window that spans a whole block
//! has no part in it; and one that opens in a block and stays open has the time *before* its opening instead, if the satellite is
//! near the object from the start of the block on.

use std::cell::OnceCell;

use super::finder::{AccessWindow, LocationSet};
use super::ground_track::GroundTrack;
use crate::tasking::vector3::{norm, sub};

/// Shortest window that BSK-RL's search reports, s, if it lies within a block.
const MIN_WINDOW_S: f64 = 0.1;
/// Windows that close less than this after the current time have closed, s.
const CLOSED_TOLERANCE_S: f64 = 1e-12;
/// Time between two samples of the trajectory that BSK-RL searches, s.
const SAMPLE_S: f64 = 30.0;
/// Factor of the distance within which BSK-RL searches for a window.
const NEAR_FACTOR: f64 = 1.1;

/// Kind of an opportunity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum OpportunityKind {
    /// A target can be imaged.
    Target,
    /// A ground station can receive data.
    GroundStation,
}

/// A time during which an object is accessible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Opportunity {
    /// Kind of the object.
    pub kind: OpportunityKind,
    /// Index of the object among those of its kind.
    pub object: usize,
    /// Time of opening, s.
    pub open_s: f64,
    /// Time of closing, s.
    pub close_s: f64,
}

/// Opportunities of a satellite in the order of their close.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpportunityList {
    /// Opportunities of each kind, in order.
    items: [Vec<Opportunity>; 2],
    /// Time up to which opportunities are computed, s.
    computed_s: f64,
}

impl OpportunityList {
    /// All opportunities so far, in order.
    #[must_use]
    pub fn all(&self) -> Vec<Opportunity> {
        let mut all = self.items.concat();
        all.sort_by(|a, b| a.close_s.total_cmp(&b.close_s));
        all
    }

    /// Time up to which opportunities are computed, s.
    #[must_use]
    pub const fn computed_s(&self) -> f64 {
        self.computed_s
    }

    /// Opportunities of a kind that have not closed at a time, s.
    #[must_use]
    pub fn upcoming(&self, kind: OpportunityKind, now_s: f64) -> &[Opportunity] {
        let items = &self.items[kind as usize];
        &items[items.partition_point(|item| item.close_s < now_s + CLOSED_TOLERANCE_S)..]
    }

    /// End of the block that a computation of `duration_s` more would fill, s; `None` if it computes nothing.
    #[must_use]
    pub fn next_block_end(&self, duration_s: f64, generation_s: f64) -> Option<f64> {
        /// Two steps of the trajectory that BSK-RL searches.
        const MIN_DURATION_S: f64 = 60.0;
        if duration_s <= 0.0 {
            return None;
        }
        let end = self.computed_s + duration_s.max(MIN_DURATION_S).max(generation_s);
        Some(generation_s * (end / generation_s).ceil())
    }

    /// Adds the block up to `end_s` of location sets, which must be searched to that time along the track.
    pub fn add_block(&mut self, end_s: f64, sets: &[(OpportunityKind, &LocationSet)], track: &GroundTrack) {
        let block = SearchBlock { start_s: self.computed_s, end_s, track, highest_m: OnceCell::new() };
        for (kind, set) in sets {
            let windows = set.closed_windows().iter().copied().chain(set.open_windows());
            let mut added: Vec<Opportunity> =
                windows.filter_map(|window| block.cut(*kind, set, &window)).collect();
            // BSK-RL computes location by location, and the windows of each in order of time.
            added.sort_by(|a, b| a.object.cmp(&b.object).then(a.open_s.total_cmp(&b.open_s)));
            let items = &mut self.items[*kind as usize];
            for item in added {
                join_or_push(items, item, block.start_s);
            }
            // The sort is stable: a new opportunity comes after those that close at the same time.
            items.sort_by(|a, b| a.close_s.total_cmp(&b.close_s));
        }
        self.computed_s = end_s;
    }
}

/// Appends an opportunity. One that begins with the block is joined with the part that ended there.
fn join_or_push(items: &mut Vec<Opportunity>, mut item: Opportunity, block_start_s: f64) {
    if item.open_s == block_start_s {
        let earlier =
            items.iter().position(|other| other.object == item.object && other.close_s == item.open_s);
        if let Some(index) = earlier {
            item.open_s = items.remove(index).open_s;
        }
    }
    items.push(item);
}

/// A block of time.
struct SearchBlock<'a> {
    start_s: f64,
    end_s: f64,
    track: &'a GroundTrack,
    /// Largest distance of the samples from the Earth's centre, m, once it is needed.
    highest_m: OnceCell<f64>,
}

impl SearchBlock<'_> {
    /// Part of a window within the block, as BSK-RL's search finds it.
    fn cut(&self, kind: OpportunityKind, set: &LocationSet, window: &AccessWindow) -> Option<Opportunity> {
        let (start_s, end_s) = (self.start_s, self.end_s);
        if window.close_s <= start_s || window.open_s >= end_s {
            return None;
        }
        let is_open_at_start = window.open_s < start_s || (start_s == 0.0 && window.open_s == 0.0);
        let is_open_at_end = window.close_s > end_s;
        let (open_s, close_s) = match (is_open_at_start, is_open_at_end) {
            (true, true) => return None,
            (true, false) => (start_s, window.close_s),
            (false, true) if self.is_near_before(set, window) => (start_s, window.open_s),
            (false, true) => (window.open_s, end_s),
            (false, false) if window.close_s - window.open_s > MIN_WINDOW_S => {
                (window.open_s, window.close_s)
            }
            (false, false) => return None,
        };
        Some(Opportunity { kind, object: window.location, open_s, close_s })
    }

    /// True if the satellite is near a location at all samples from the start of the block to the opening of a window, the very
    /// first one aside.
    fn is_near_before(&self, set: &LocationSet, window: &AccessWindow) -> bool {
        let object = set.position(window.location);
        let samples = ((self.end_s - self.start_s) / SAMPLE_S).round() as usize;
        let at = |sample: usize| self.track.position(self.start_s + sample as f64 * SAMPLE_S);
        let highest =
            *self.highest_m.get_or_init(|| (0..=samples).map(|sample| norm(&at(sample))).fold(0.0, f64::max));
        let near = NEAR_FACTOR * (highest - norm(object)) / libm::sin(set.min_elevation_rad(window.location));
        let opening = ((window.open_s - self.start_s) / SAMPLE_S).ceil() as usize;
        (1..=opening.clamp(1, samples)).all(|sample| norm(&sub(&at(sample), object)) < near)
    }
}
