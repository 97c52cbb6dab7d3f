//! Search for the times at which locations on the ground see a satellite above a minimum elevation.
//!
//! One scalar product for each location and node selects the arcs that can matter; within them Newton's method on the Hermite
//! path finds when the elevation equals the minimum.

use pulp::{Arch, Simd, WithSimd};

use super::ground_track::GroundTrack;
use crate::tasking::orbit::HermiteArc;
use crate::tasking::orbit::propagator::STEP_S;
use crate::tasking::vector3::{Vector3, dot, norm, scale, sub};

/// Central angle that a satellite moves over the ground in half an arc at most, rad: at 150 km, against the Earth's rotation.
const HALF_ARC_RAD: f64 = 0.039;

/// Locations on the ground with the same minimum elevation.
#[derive(Debug, Clone, PartialEq)]
pub struct LocationSet {
    positions: Vec<Vector3<f64>>,
    /// Unit vectors by component, for the scalar products.
    headings: [Vec<f64>; 3],
    min_elevation_rad: f64,
    /// Sine of the minimum elevation.
    sine: f64,
    /// Least distance of the locations from the Earth's centre, m.
    min_radius_m: f64,
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
    /// Creates a set of planet-fixed positions, m.
    #[must_use]
    pub fn new(positions: Vec<Vector3<f64>>, min_elevation_rad: f64) -> Self {
        let headings = [0, 1, 2].map(|i| positions.iter().map(|q| q[i] / norm(q)).collect());
        let min_radius_m = positions.iter().map(norm).fold(f64::INFINITY, f64::min);
        let opened = vec![None; positions.len()];
        Self {
            positions,
            headings,
            min_elevation_rad,
            sine: libm::sin(min_elevation_rad),
            min_radius_m,
            searched_arcs: 0,
            opened,
            windows: Vec::new(),
        }
    }

    /// Number of locations of the set.
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

    /// Minimum elevation of access, rad.
    #[must_use]
    pub const fn min_elevation_rad(&self) -> f64 {
        self.min_elevation_rad
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
        if self.positions.is_empty() {
            self.searched_arcs = (seconds / STEP_S).ceil() as usize;
            return;
        }
        let threshold = self.cosine_threshold(track.max_radius_m());
        let end = ((seconds / STEP_S).ceil() as usize).min(track.nodes().len().saturating_sub(1));
        let mut near = self.near_locations(track, self.searched_arcs, threshold);
        for arc in self.searched_arcs..end {
            let near_end = self.near_locations(track, arc + 1, threshold);
            let path = track.arc(arc);
            for location in merge_sorted(&near, &near_end) {
                self.search_arc(location, arc, &path);
            }
            near = near_end;
        }
        self.searched_arcs = self.searched_arcs.max(end);
    }

    /// Cosine of the largest central angle at a node from which an arc can reach the minimum elevation.
    fn cosine_threshold(&self, max_radius_m: f64) -> f64 {
        let ratio = self.min_radius_m * libm::cos(self.min_elevation_rad) / max_radius_m;
        let angle = libm::acos(ratio.clamp(-1.0, 1.0)) - self.min_elevation_rad;
        libm::cos((angle + HALF_ARC_RAD).clamp(0.0, std::f64::consts::PI))
    }

    /// Locations within reach at a node, in order.
    fn near_locations(&self, track: &GroundTrack, node: usize, threshold: f64) -> Vec<usize> {
        let position = &track.nodes()[node].position;
        let heading = scale(position, 1.0 / norm(position));
        let mut near = Vec::new();
        Arch::new().dispatch(NearLocations { headings: &self.headings, heading, threshold, near: &mut near });
        near
    }

    /// Finds the opening and closing of a location within an arc.
    fn search_arc(&mut self, location: usize, arc: usize, path: &HermiteArc) {
        let q = &self.positions[location];
        let elevation = ElevationExcess {
            path,
            position: *q,
            heading: [0, 1, 2].map(|i| self.headings[i][location]),
            sine: self.sine,
        };
        let (start, end) = (arc as f64 * STEP_S, (arc + 1) as f64 * STEP_S);
        let (at_start, at_end) = (elevation.at(start), elevation.at(end));
        if arc == 0 && at_start.value > 0.0 {
            self.opened[location] = Some(0.0);
        }
        match (self.opened[location], at_end.value > 0.0) {
            (None, true) => {
                self.opened[location] = Some(elevation.root([start, end], [at_start.value, at_end.value]));
            }
            (Some(open_s), false) => {
                let close_s = elevation.root([end, start], [at_end.value, at_start.value]);
                self.windows.push(AccessWindow { location, open_s, close_s });
                self.opened[location] = None;
            }
            (None, false) if at_start.slope > 0.0 && at_end.slope < 0.0 => {
                let top = elevation.summit(start, end);
                let highest = elevation.at(top).value;
                if highest > 0.0 {
                    let open_s = elevation.root([start, top], [at_start.value, highest]);
                    let close_s = elevation.root([end, top], [at_end.value, highest]);
                    self.windows.push(AccessWindow { location, open_s, close_s });
                }
            }
            _ => {}
        }
    }
}

/// Union of two sorted lists.
fn merge_sorted(a: &[usize], b: &[usize]) -> Vec<usize> {
    let mut merged = Vec::with_capacity(a.len() + b.len());
    let (mut i, mut j) = (0, 0);
    while i < a.len() || j < b.len() {
        let next = match (a.get(i), b.get(j)) {
            (Some(x), Some(y)) => *x.min(y),
            (Some(x), None) => *x,
            (None, Some(y)) => *y,
            (None, None) => break,
        };
        i += usize::from(a.get(i) == Some(&next));
        j += usize::from(b.get(j) == Some(&next));
        merged.push(next);
    }
    merged
}

/// Search for the headings whose scalar product with one exceeds a threshold.
struct NearLocations<'a> {
    headings: &'a [Vec<f64>; 3],
    heading: Vector3<f64>,
    threshold: f64,
    near: &'a mut Vec<usize>,
}

impl WithSimd for NearLocations<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        /// Locations that are tested together.
        const TOGETHER: usize = 16;
        let Self { headings: [x, y, z], heading: [a, b, c], threshold, near } = self;
        let chunks = x.chunks(TOGETHER).zip(y.chunks(TOGETHER)).zip(z.chunks(TOGETHER));
        for (index, ((x, y), z)) in chunks.enumerate() {
            let mut products = [f64::NEG_INFINITY; TOGETHER];
            for (((product, x), y), z) in products.iter_mut().zip(x).zip(y).zip(z) {
                *product = a * x + b * y + c * z;
            }
            let mut is_any_near = false;
            for product in &products {
                is_any_near |= *product > threshold;
            }
            if is_any_near {
                for (i, product) in products.iter().enumerate() {
                    if *product > threshold {
                        near.push(index * TOGETHER + i);
                    }
                }
            }
        }
    }
}

/// Excess of the elevation over its minimum, as a length: the satellite's height over the location's horizon less its range times
/// the sine of the minimum elevation.
struct ElevationExcess<'a> {
    path: &'a HermiteArc,
    position: Vector3<f64>,
    heading: Vector3<f64>,
    sine: f64,
}

/// A value and its rate of change.
struct ValueAndSlope {
    value: f64,
    slope: f64,
}

impl ElevationExcess<'_> {
    fn at(&self, seconds: f64) -> ValueAndSlope {
        let away = sub(&self.path.position(seconds), &self.position);
        let velocity = self.path.velocity(seconds);
        let range = norm(&away);
        ValueAndSlope {
            value: dot(&away, &self.heading) - self.sine * range,
            slope: dot(&velocity, &self.heading) - self.sine * dot(&away, &velocity) / range,
        }
    }

    /// Time at which the excess is zero, between a time where it is not positive and one where it is positive. `excess` has its
    /// values at both. Newton's method starts from the secant and bisects where it leaves the interval.
    fn root(&self, [mut below, mut above]: [f64; 2], excess: [f64; 2]) -> f64 {
        let share = excess[0] / (excess[0] - excess[1]);
        let mut time = below + (above - below) * share.clamp(0.0, 1.0);
        for _ in 0..50 {
            let ValueAndSlope { value, slope } = self.at(time);
            if value > 0.0 {
                above = time;
            } else {
                below = time;
            }
            let mut next = time - value / slope;
            let inside = (next - below) * (next - above) < 0.0;
            if !inside {
                next = 0.5 * (below + above);
            }
            if (next - time).abs() < 1e-9 {
                return next;
            }
            time = next;
        }
        time
    }

    /// Time of the largest excess between two times: bisection of the slope, then of the secant.
    fn summit(&self, start: f64, end: f64) -> f64 {
        let (mut rising, mut falling) = (start, end);
        let (mut rising_slope, mut falling_slope) = (self.at(rising).slope, self.at(falling).slope);
        for _ in 0..40 {
            let secant = rising + (falling - rising) * rising_slope / (rising_slope - falling_slope);
            let time = secant.clamp(rising + 0.05 * (falling - rising), falling - 0.05 * (falling - rising));
            let slope = self.at(time).slope;
            if slope > 0.0 {
                (rising, rising_slope) = (time, slope);
            } else {
                (falling, falling_slope) = (time, slope);
            }
            if falling - rising < 1e-3 || slope.abs() < 1e-6 {
                return time;
            }
        }
        0.5 * (rising + falling)
    }
}
