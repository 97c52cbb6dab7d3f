//! Search for the times at which locations on the ground see a satellite above a minimum elevation.
//!
//! One scalar product for each location and node selects the arcs that can matter; [`arc_search`](super::arc_search) finds when the
//! elevation equals the minimum within them.

use std::sync::Arc;

use super::arc_search::{ArcSearch, ElevationExcess};
use super::ground_track::GroundTrack;
use super::locations::Locations;
use crate::tasking::orbit::propagator::STEP_S;

/// Central angle that a satellite moves over the ground in half an arc at most, rad: at 150 km, against the Earth's rotation.
pub(super) const HALF_ARC_RAD: f64 = 0.039;

/// Locations and the windows in which they see one satellite.
#[derive(Debug, Clone, PartialEq)]
pub struct LocationSet {
    locations: Arc<Locations>,
    /// Number of arcs that were searched.
    searched_arcs: usize,
    /// Time at which each location's current window opened, if it is open at the end of the searched arcs.
    opened: Vec<Option<f64>>,
    windows: Vec<AccessWindow>,
}

/// A time during which a location sees the satellite above the minimum elevation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccessWindow {
    /// Index of the location.
    pub location: usize,
    /// Opening, s; 0 if it was open at the start.
    pub open_s: f64,
    /// Time of closing, s.
    pub close_s: f64,
}

impl LocationSet {
    /// Creates a set whose windows are not searched yet.
    #[must_use]
    pub fn new(locations: Arc<Locations>) -> Self {
        let opened = vec![None; locations.len()];
        Self { locations, searched_arcs: 0, opened, windows: Vec::new() }
    }

    /// Number of locations of the set.
    #[must_use]
    pub fn len(&self) -> usize {
        self.opened.len()
    }

    /// True if there are no locations.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.opened.is_empty()
    }

    /// Windows that closed within the searched time, in the order of closing arcs.
    #[must_use]
    pub fn closed_windows(&self) -> &[AccessWindow] {
        &self.windows
    }

    /// Windows that are open at the end of the searched time, with an infinite end.
    pub fn open_windows(&self) -> impl Iterator<Item = AccessWindow> {
        let open = |(location, opened): (usize, &Option<f64>)| {
            opened.map(|open_s| AccessWindow { location, open_s, close_s: f64::INFINITY })
        };
        self.opened.iter().enumerate().filter_map(open)
    }

    /// Time up to which windows are known, s.
    #[must_use]
    pub fn searched_s(&self) -> f64 {
        self.searched_arcs as f64 * STEP_S
    }

    /// Searches all arcs of a track up to a time, s. The track must extend to it.
    pub fn search_to(&mut self, seconds: f64, track: &GroundTrack) {
        let wanted = (seconds / STEP_S).ceil() as usize;
        if self.is_empty() {
            self.searched_arcs = self.searched_arcs.max(wanted);
            return;
        }
        let end = wanted.min(track.nodes().len().saturating_sub(1));
        if self.searched_arcs >= end {
            return;
        }
        let locations = Arc::clone(&self.locations);
        let threshold = cosine_threshold(&locations, track.max_radius_m());
        let find_near = |node: usize, near: &mut Vec<usize>| {
            locations.find_near(&track.nodes()[node].position, threshold, near);
            near.sort_unstable();
        };
        let (mut near, mut near_end) = (Vec::new(), Vec::new());
        find_near(self.searched_arcs, &mut near);
        for arc in self.searched_arcs..end {
            find_near(arc + 1, &mut near_end);
            for location in (MergeSorted { a: &near, b: &near_end }) {
                self.search_arc(location, &locations.elevation_excess(location), arc, track);
            }
            std::mem::swap(&mut near, &mut near_end);
        }
        self.searched_arcs = end;
    }

    /// Finds the opening and closing of a location within an arc.
    fn search_arc(&mut self, location: usize, elevation: &ElevationExcess, arc: usize, track: &GroundTrack) {
        let (start, end) = (&track.nodes()[arc], &track.nodes()[arc + 1]);
        if arc == 0 && elevation.value(&start.position) > 0.0 {
            self.opened[location] = Some(0.0);
        }
        match (self.opened[location], elevation.value(&end.position) > 0.0) {
            (None, true) => {
                self.opened[location] = Some(ArcSearch::new(elevation, arc, track).crossing());
            }
            (Some(open_s), false) => {
                let close_s = ArcSearch::new(elevation, arc, track).crossing();
                self.windows.push(AccessWindow { location, open_s, close_s });
                self.opened[location] = None;
            }
            (None, false) if elevation.at_node(start).slope > 0.0 && elevation.at_node(end).slope < 0.0 => {
                if let Some([open_s, close_s]) = ArcSearch::new(elevation, arc, track).crossings() {
                    self.windows.push(AccessWindow { location, open_s, close_s });
                }
            }
            _ => {}
        }
    }
}

/// Cosine of the largest central angle at a node from which an arc can reach the minimum elevation.
fn cosine_threshold(locations: &Locations, max_radius_m: f64) -> f64 {
    let min_elevation_rad = locations.min_elevation_rad();
    let ratio = locations.min_radius_m() * libm::cos(min_elevation_rad) / max_radius_m;
    let angle = libm::acos(ratio.clamp(-1.0, 1.0)) - min_elevation_rad;
    libm::cos((angle + HALF_ARC_RAD).clamp(0.0, std::f64::consts::PI))
}

/// Union of two sorted lists, in order.
struct MergeSorted<'a> {
    a: &'a [usize],
    b: &'a [usize],
}

impl Iterator for MergeSorted<'_> {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        let next = match (self.a.first(), self.b.first()) {
            (Some(x), Some(y)) => *x.min(y),
            (Some(x), None) => *x,
            (None, Some(y)) => *y,
            (None, None) => return None,
        };
        self.a = &self.a[usize::from(self.a.first() == Some(&next))..];
        self.b = &self.b[usize::from(self.b.first() == Some(&next))..];
        Some(next)
    }
}
