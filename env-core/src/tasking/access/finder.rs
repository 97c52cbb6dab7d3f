//! Search for the times at which locations on the ground see a satellite above a minimum elevation.
//!
//! One scalar product for each location and node selects the arcs that can matter; within them Newton's method on the Hermite
//! path finds when the elevation equals the minimum.

use std::sync::Arc;

use pulp::{Arch, Simd, WithSimd};

use super::ground_track::GroundTrack;
use crate::tasking::orbit::propagator::STEP_S;
use crate::tasking::orbit::{HermiteArc, OrbitNode};
use crate::tasking::vector3::{Vector3, dot, norm, scale, sub};

/// Central angle that a satellite moves over the ground in half an arc at most, rad: at 150 km, against the Earth's rotation.
const HALF_ARC_RAD: f64 = 0.039;

/// Locations that are tested together.
const TOGETHER: usize = 16;

/// Unit vectors of [`TOGETHER`] locations by component; unused ones are NaN.
type Headings = [[f64; TOGETHER]; 3];

/// Locations on the ground with the same minimum elevation.
#[derive(Debug, PartialEq)]
pub struct Locations {
    positions: Vec<Vector3<f64>>,
    headings: Vec<Headings>,
    min_elevation_rad: f64,
    /// Sine of the minimum elevation.
    sine: f64,
    /// Least distance of the locations from the Earth's centre, m.
    min_radius_m: f64,
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
    /// Creates locations at planet-fixed positions, m.
    #[must_use]
    pub fn new(positions: Vec<Vector3<f64>>, min_elevation_rad: f64) -> Self {
        let mut headings = vec![[[f64::NAN; TOGETHER]; 3]; positions.len().div_ceil(TOGETHER)];
        let mut min_radius_m = f64::INFINITY;
        for (index, position) in positions.iter().enumerate() {
            let radius = norm(position);
            min_radius_m = radius.min(min_radius_m);
            for (component, x) in headings[index / TOGETHER].iter_mut().zip(position) {
                component[index % TOGETHER] = x / radius;
            }
        }
        let sine = libm::sin(min_elevation_rad);
        Self { positions, headings, min_elevation_rad, sine, min_radius_m }
    }

    /// Minimum elevation of access, rad.
    #[must_use]
    pub const fn min_elevation_rad(&self) -> f64 {
        self.min_elevation_rad
    }

    /// Cosine of the largest central angle at a node from which an arc can reach the minimum elevation.
    fn cosine_threshold(&self, max_radius_m: f64) -> f64 {
        let ratio = self.min_radius_m * libm::cos(self.min_elevation_rad) / max_radius_m;
        let angle = libm::acos(ratio.clamp(-1.0, 1.0)) - self.min_elevation_rad;
        libm::cos((angle + HALF_ARC_RAD).clamp(0.0, std::f64::consts::PI))
    }

    /// Finds the locations within reach at a position of the satellite, in order.
    fn find_near(&self, position: &Vector3<f64>, threshold: f64, near: &mut Vec<usize>) {
        let heading = scale(position, 1.0 / norm(position));
        near.clear();
        Arch::new().dispatch(NearLocations { headings: &self.headings, heading, threshold, near });
    }

    /// Excess of the elevation of a satellite at a position.
    fn elevation_excess(&self, location: usize) -> ElevationExcess {
        let heading = &self.headings[location / TOGETHER];
        ElevationExcess {
            position: self.positions[location],
            heading: [0, 1, 2].map(|i| heading[i][location % TOGETHER]),
            sine: self.sine,
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

    /// Planet-fixed position of a location, m.
    #[must_use]
    pub fn position(&self, location: usize) -> &Vector3<f64> {
        &self.locations.positions[location]
    }

    /// Minimum elevation of access, rad.
    #[must_use]
    pub fn min_elevation_rad(&self) -> f64 {
        self.locations.min_elevation_rad
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
    fn with_simd<S: Simd>(self, _: S) {
        let Self { headings, heading: [a, b, c], threshold, near } = self;
        for (index, [x, y, z]) in headings.iter().enumerate() {
            let mut products = [0.0; TOGETHER];
            for i in 0..TOGETHER {
                products[i] = a * x[i] + b * y[i] + c * z[i];
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
struct ElevationExcess {
    position: Vector3<f64>,
    heading: Vector3<f64>,
    sine: f64,
}

/// A value and its rate of change.
#[derive(Clone, Copy)]
struct ValueAndSlope {
    value: f64,
    slope: f64,
}

impl ElevationExcess {
    fn value(&self, satellite: &Vector3<f64>) -> f64 {
        let away = sub(satellite, &self.position);
        dot(&away, &self.heading) - self.sine * norm(&away)
    }

    fn of(&self, satellite: &Vector3<f64>, velocity: &Vector3<f64>) -> ValueAndSlope {
        let away = sub(satellite, &self.position);
        let range = norm(&away);
        ValueAndSlope {
            value: dot(&away, &self.heading) - self.sine * range,
            slope: dot(velocity, &self.heading) - self.sine * dot(&away, velocity) / range,
        }
    }

    fn at_node(&self, node: &OrbitNode) -> ValueAndSlope {
        self.of(&node.position, &node.velocity)
    }
}

/// Search for the times at which the elevation equals its minimum within an arc.
struct ArcSearch<'a> {
    elevation: &'a ElevationExcess,
    path: HermiteArc,
    start: ValueAndSlope,
    end: ValueAndSlope,
}

impl<'a> ArcSearch<'a> {
    fn new(elevation: &'a ElevationExcess, arc: usize, track: &GroundTrack) -> Self {
        let (start, end) =
            (elevation.at_node(&track.nodes()[arc]), elevation.at_node(&track.nodes()[arc + 1]));
        Self { elevation, path: track.arc(arc), start, end }
    }

    fn at(&self, seconds: f64) -> ValueAndSlope {
        self.elevation.of(&self.path.position(seconds), &self.path.velocity(seconds))
    }

    fn times(&self) -> [f64; 2] {
        [self.path.start_s, self.path.start_s + STEP_S]
    }

    /// The time at which the excess changes its sign, if it has different signs at the ends.
    fn crossing(&self) -> f64 {
        let times = self.times();
        self.root(times, [self.start, self.end])
    }

    /// The times at which the excess becomes positive and negative, if it rises at the start and falls at the end.
    fn crossings(&self) -> Option<[f64; 2]> {
        let [start, end] = self.times();
        let top = self.summit(start, end);
        let highest = self.at(top);
        (highest.value > 0.0).then(|| {
            [self.root([start, top], [self.start, highest]), self.root([top, end], [highest, self.end])]
        })
    }

    /// Time at which the excess is zero between two times where its signs differ. `excess` has its values at both. Newton's method
    /// starts from inverse interpolation and bisects where it leaves the interval.
    fn root(&self, [mut low, mut high]: [f64; 2], [first, last]: [ValueAndSlope; 2]) -> f64 {
        /// Newton's method converges quadratically: after a step of this length, s, the error is below a nanosecond.
        const LAST_STEP_S: f64 = 1e-4;
        let rises = last.value > first.value;
        let mut time = inverse_interpolation([low, high], [first, last]);
        for _ in 0..50 {
            let ValueAndSlope { value, slope } = self.at(time);
            if (value > 0.0) == rises {
                high = time;
            } else {
                low = time;
            }
            let next = time - value / slope;
            if next > low && next < high || (next - time).abs() < 1e-9 {
                if (next - time).abs() < LAST_STEP_S {
                    return next;
                }
                time = next;
            } else {
                time = 0.5 * (low + high);
            }
        }
        time
    }

    /// Time of the largest excess between two times: bisection of the slope, then of the secant.
    fn summit(&self, start: f64, end: f64) -> f64 {
        let (mut rising, mut falling) = (start, end);
        let (mut rising_slope, mut falling_slope) = (self.start.slope, self.end.slope);
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

/// Time between two times at which a function is about zero: by a cubic polynomial of the value, or else the secant.
fn inverse_interpolation([start, end]: [f64; 2], [first, last]: [ValueAndSlope; 2]) -> f64 {
    let change = last.value - first.value;
    let share = -first.value / change;
    let duration = end - start;
    let secant = start + duration * share.clamp(0.0, 1.0);
    // Slopes of the time over the share of the change of the value.
    let (begin, finish) = (change / first.slope, change / last.slope);
    if !(begin > 0.0 && finish > 0.0) {
        return secant;
    }
    let (square, cube) = (3.0 * duration - 2.0 * begin - finish, begin + finish - 2.0 * duration);
    let time = start + share * (begin + share * (square + share * cube));
    if time > start && time < end { time } else { secant }
}
