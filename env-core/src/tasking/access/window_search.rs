//! Search of a block of time for the windows of locations, with the results of BSK-RL's `calculate_additional_windows`.
//!
//! BSK-RL searches within [`candidates`](super::candidates) for the times at which the elevation equals its minimum:
//!
//! 1. If the elevation is above the minimum at both ends, no time is found.
//! 2. If it is above at one end, one root is searched between the ends.
//! 3. Otherwise a maximum is searched, starting from the ends. It may be outside of them. If the elevation is above the minimum there,
//!    one root is searched between each end and the maximum.
//!
//! Windows are lost where a candidate contains several passes, since one maximum at most is found; where a satellite is visible at
//! both ends; and where the search of the maximum ends elsewhere. One root becomes the end of a window that begins with the block, if
//! the candidate does; otherwise the start of one that ends with it; and no window at all within a block.

use super::candidates::{Candidate, Crossings, find_candidates};
use super::elevation_curve::ElevationCurve;
use super::finder::AccessWindow;
use super::locations::Locations;
use super::minimum::minimise;
use super::quick_search::QuickSearch;
use super::root::find_root;
use super::trajectory::{SAMPLE_TICK, SampleRange, SearchedTrajectory};

/// Shortest time between two roots that BSK-RL accepts as a window, s.
const MIN_WINDOW_S: f64 = 0.1;

/// Farthest maximum that has a window, s from the start of the episode. Farther away the extrapolated curve levels off, and rounding
/// decides where the search ends. With the last bits of the samples changed, BSK-RL itself finds no window there in most cases.
const FARTHEST_MAXIMUM_S: f64 = 1e7;

/// A search of a block for windows.
pub struct WindowSearch<'a> {
    locations: &'a Locations,
    trajectory: &'a SearchedTrajectory,
    block: SampleRange,
}

impl<'a> WindowSearch<'a> {
    /// Prepares the search of a block.
    #[must_use]
    pub const fn new(
        locations: &'a Locations,
        trajectory: &'a SearchedTrajectory,
        block: SampleRange,
    ) -> Self {
        Self { locations, trajectory, block }
    }

    /// Windows in the order in which BSK-RL finds them: location by location, in the order of time.
    #[must_use]
    pub fn windows(&self) -> Vec<AccessWindow> {
        let candidates = find_candidates(self.locations, self.trajectory, self.block);
        candidates.iter().filter_map(|candidate| self.window(candidate, self.crossings(candidate))).collect()
    }

    /// Times at which the elevation equals its minimum in a candidate, as BSK-RL finds them.
    fn crossings(&self, candidate: &Candidate) -> Crossings {
        self.quick_crossings(candidate).unwrap_or_else(|| self.slow_crossings(candidate))
    }

    /// Times that BSK-RL finds in a candidate by a quick search; `None` if they are not certain.
    #[must_use]
    pub fn quick_crossings(&self, candidate: &Candidate) -> Option<Crossings> {
        QuickSearch::new(self.locations, self.trajectory, candidate).crossings()
    }

    /// Times at which the elevation equals its minimum in a candidate, by BSK-RL's method.
    #[must_use]
    pub fn slow_crossings(&self, candidate: &Candidate) -> Crossings {
        let curve = ElevationCurve::new(self.trajectory.spline(), self.locations, candidate.location);
        let shortfall = |seconds: f64| curve.shortfall(seconds);
        let SampleRange { first, last } = candidate.samples;
        let [start, end] = [first, last].map(|sample| SAMPLE_TICK.time_s(sample as u64));
        match [start, end].map(|time| shortfall(time) < 0.0) {
            [true, true] => return Crossings::None,
            [false, false] => {}
            _ => return Crossings::One(find_root(shortfall, [start, end])),
        }
        let top = minimise(shortfall, [start, end]);
        if top.y < 0.0 && top.x.abs() < FARTHEST_MAXIMUM_S {
            let open = find_root(shortfall, [start, top.x]);
            let close = find_root(shortfall, [top.x, end]);
            if close - open > MIN_WINDOW_S {
                return Crossings::Two([open, close]);
            }
        }
        Crossings::None
    }

    /// The window of a candidate with these crossings.
    fn window(&self, candidate: &Candidate, crossings: Crossings) -> Option<AccessWindow> {
        let [open_s, close_s] = match crossings {
            Crossings::Two(times) => times,
            Crossings::One(time) if candidate.samples.first == self.block.first => {
                [self.block.start_s(), time]
            }
            Crossings::One(time) if candidate.samples.last == self.block.last => [time, self.block.end_s()],
            _ => return None,
        };
        Some(AccessWindow { location: candidate.location, open_s, close_s })
    }
}
