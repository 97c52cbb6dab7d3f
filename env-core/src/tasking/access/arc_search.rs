//! Search for the times at which the elevation of a satellite equals its minimum within an arc: Newton's method on the Hermite path.

use super::ground_track::GroundTrack;
use crate::tasking::orbit::propagator::STEP_S;
use crate::tasking::orbit::{HermiteArc, OrbitNode};
use crate::tasking::vector3::{Vector3, dot, norm, sub};

/// Excess of the elevation over its minimum, as a length: the satellite's height over the location's horizon less its range times
/// the sine of the minimum elevation. It is at most the excess of the largest range over the range.
pub(super) struct ElevationExcess {
    pub(super) position: Vector3<f64>,
    pub(super) heading: Vector3<f64>,
    pub(super) sine: f64,
    /// Largest range of access, m; infinite if there is no limit.
    pub(super) max_range_m: f64,
}

/// A value and its rate of change.
#[derive(Clone, Copy)]
pub(super) struct ValueAndSlope {
    value: f64,
    pub(super) slope: f64,
}

impl ElevationExcess {
    /// The excess at a position.
    pub(super) fn value(&self, satellite: &Vector3<f64>) -> f64 {
        let away = sub(satellite, &self.position);
        let range = norm(&away);
        (dot(&away, &self.heading) - self.sine * range).min(self.max_range_m - range)
    }

    fn of(&self, satellite: &Vector3<f64>, velocity: &Vector3<f64>) -> ValueAndSlope {
        let away = sub(satellite, &self.position);
        let range = norm(&away);
        let range_rate = dot(&away, velocity) / range;
        let by_elevation = ValueAndSlope {
            value: dot(&away, &self.heading) - self.sine * range,
            slope: dot(velocity, &self.heading) - self.sine * range_rate,
        };
        let by_range = ValueAndSlope { value: self.max_range_m - range, slope: -range_rate };
        if by_range.value < by_elevation.value { by_range } else { by_elevation }
    }

    /// The excess at a node.
    pub(super) fn at_node(&self, node: &OrbitNode) -> ValueAndSlope {
        self.of(&node.position, &node.velocity)
    }
}

/// Search for the times at which the elevation equals its minimum within an arc.
pub(super) struct ArcSearch<'a> {
    elevation: &'a ElevationExcess,
    path: HermiteArc,
    start: ValueAndSlope,
    end: ValueAndSlope,
}

impl<'a> ArcSearch<'a> {
    /// Prepares the search of the arc with this index.
    pub(super) fn new(elevation: &'a ElevationExcess, arc: usize, track: &GroundTrack) -> Self {
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
    pub(super) fn crossing(&self) -> f64 {
        let times = self.times();
        self.root(times, [self.start, self.end])
    }

    /// The times at which the excess becomes positive and negative, if it rises at the start and falls at the end.
    pub(super) fn crossings(&self) -> Option<[f64; 2]> {
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
