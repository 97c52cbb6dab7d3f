//! Search for the times at which locations on the ground see a satellite above a minimum elevation.
//!
//! One scalar product for each location and node selects the arcs that can matter; [`arc_search`](super::arc_search) finds when the
//! elevation equals the minimum within them.

use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};

use super::arc_search::{ArcSearch, ElevationExcess};
use super::ground_track::GroundTrack;
use crate::tasking::orbit::propagator::STEP_S;
use crate::tasking::pack::Pack;
use crate::tasking::real::Real;
use crate::tasking::vector3::{Vector3, norm, scale};

/// Central angle that a satellite moves over the ground in half an arc at most, rad: at 150 km, against the Earth's rotation.
pub(super) const HALF_ARC_RAD: f64 = 0.039;

/// Locations that are tested together.
const TOGETHER: usize = 16;

/// Unit vectors of [`TOGETHER`] locations by component; unused ones are NaN.
type Headings = [[f64; TOGETHER]; 3];

/// Locations on the ground.
#[derive(Debug, PartialEq)]
pub struct Locations {
    positions: Vec<Vector3<f64>>,
    headings: Vec<Headings>,
    /// The least of the minimum elevations.
    min_elevation_rad: f64,
    /// Limits of each location, or one for all.
    limits: Vec<AccessLimit>,
    /// Distances of the locations from the Earth's centre, m.
    radii_m: Vec<f64>,
    /// Least distance of the locations from the Earth's centre, m.
    min_radius_m: f64,
}

/// Limits of the access of a location.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccessLimit {
    min_elevation_rad: f64,
    /// Sine of the minimum elevation.
    sine: f64,
    max_range_m: f64,
}

impl AccessLimit {
    /// Creates limits of the elevation, rad, and of the range, m, which may be infinite.
    #[must_use]
    pub fn new(min_elevation_rad: f64, max_range_m: f64) -> Self {
        Self { min_elevation_rad, sine: libm::sin(min_elevation_rad), max_range_m }
    }
}

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

impl Locations {
    /// Creates locations at planet-fixed positions, m, with the same minimum elevation.
    #[must_use]
    pub fn new(positions: Vec<Vector3<f64>>, min_elevation_rad: f64) -> Self {
        Self::with_limits(positions, vec![AccessLimit::new(min_elevation_rad, f64::INFINITY)])
    }

    /// Creates locations at planet-fixed positions, m, with the limits of each, or with one for all.
    #[must_use]
    pub fn with_limits(positions: Vec<Vector3<f64>>, limits: Vec<AccessLimit>) -> Self {
        let mut headings = vec![[[f64::NAN; TOGETHER]; 3]; positions.len().div_ceil(TOGETHER)];
        let radii_m: Vec<f64> = positions.iter().map(norm).collect();
        let min_radius_m = radii_m.iter().copied().fold(f64::INFINITY, f64::min);
        for (index, (position, radius)) in positions.iter().zip(&radii_m).enumerate() {
            for (component, x) in headings[index / TOGETHER].iter_mut().zip(position) {
                component[index % TOGETHER] = x / radius;
            }
        }
        let elevations = limits.iter().map(|limit| limit.min_elevation_rad);
        let min_elevation_rad = elevations.fold(std::f64::consts::FRAC_PI_2, f64::min);
        Self { positions, headings, min_elevation_rad, limits, radii_m, min_radius_m }
    }

    /// Number of the locations.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.positions.len()
    }

    /// True if there are no locations.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Planet-fixed position of a location, m.
    #[must_use]
    pub fn position(&self, location: usize) -> &Vector3<f64> {
        &self.positions[location]
    }

    /// Distances of the locations from the Earth's centre, m.
    pub(super) fn radii_m(&self) -> &[f64] {
        &self.radii_m
    }

    /// Sine of the minimum elevation of a location.
    pub(super) fn sine(&self, location: usize) -> f64 {
        self.limit(location).sine
    }

    /// Minimum elevation of the access of a location, rad.
    pub(super) fn elevation_rad(&self, location: usize) -> f64 {
        self.limit(location).min_elevation_rad
    }

    /// The least minimum elevation of access, rad.
    #[must_use]
    pub const fn min_elevation_rad(&self) -> f64 {
        self.min_elevation_rad
    }

    /// Limits of a location.
    fn limit(&self, location: usize) -> &AccessLimit {
        self.limits.get(location).unwrap_or(&self.limits[0])
    }

    /// Cosine of the largest central angle at a node from which an arc can reach the minimum elevation.
    fn cosine_threshold(&self, max_radius_m: f64) -> f64 {
        let ratio = self.min_radius_m * libm::cos(self.min_elevation_rad) / max_radius_m;
        let angle = libm::acos(ratio.clamp(-1.0, 1.0)) - self.min_elevation_rad;
        libm::cos((angle + HALF_ARC_RAD).clamp(0.0, std::f64::consts::PI))
    }

    /// Finds the locations within reach at a position of the satellite, in order.
    pub(super) fn find_near(&self, position: &Vector3<f64>, threshold: f64, near: &mut Vec<usize>) {
        let heading = scale(position, 1.0 / norm(position));
        near.clear();
        Arch::new().dispatch(NearLocations { headings: &self.headings, heading, threshold, near });
    }

    /// Excess of the elevation of a satellite at a position.
    pub(super) fn elevation_excess(&self, location: usize) -> ElevationExcess {
        let heading = &self.headings[location / TOGETHER];
        let limit = self.limit(location);
        ElevationExcess {
            position: self.positions[location],
            heading: [0, 1, 2].map(|i| heading[i][location % TOGETHER]),
            sine: limit.sine,
            max_range_m: limit.max_range_m,
        }
    }
}

impl LocationSet {
    /// Creates a set whose windows are not searched yet.
    #[must_use]
    pub fn new(locations: Arc<Locations>) -> Self {
        let opened = vec![None; locations.positions.len()];
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
        let threshold = locations.cosine_threshold(track.max_radius_m());
        let (mut near, mut near_end) = (Vec::new(), Vec::new());
        locations.find_near(&track.nodes()[self.searched_arcs].position, threshold, &mut near);
        for arc in self.searched_arcs..end {
            locations.find_near(&track.nodes()[arc + 1].position, threshold, &mut near_end);
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

/// Search for the headings whose scalar product with one exceeds a threshold.
struct NearLocations<'a> {
    headings: &'a [Headings],
    heading: Vector3<f64>,
    threshold: f64,
    near: &'a mut Vec<usize>,
}

impl WithSimd for NearLocations<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F64_LANES {
            8 => self.find::<S, 2>(simd),
            4 => self.find::<S, 4>(simd),
            2 => self.find::<S, 8>(simd),
            _ => self.find::<S, 16>(simd),
        }
    }
}

impl NearLocations<'_> {
    /// Finds the locations with `N` registers for those that are tested together.
    #[inline(always)]
    fn find<S: Simd, const N: usize>(self, simd: S) {
        let [a, b, c] = self.heading.map(|x| Pack::<S, N>::splat(simd, x));
        let threshold = Pack::splat(simd, self.threshold);
        for (index, [x, y, z]) in self.headings.iter().enumerate() {
            let product = a * Pack::load(simd, x) + b * Pack::load(simd, y) + c * Pack::load(simd, z);
            if product.any(threshold.less_than(product)) {
                let mut products = [0.0; TOGETHER];
                product.store(&mut products);
                for (i, product) in products.iter().enumerate() {
                    if *product > self.threshold {
                        self.near.push(index * TOGETHER + i);
                    }
                }
            }
        }
    }
}
