//! Minimum of a function of one variable, as SciPy's `minimize_scalar` searches it from an interval: a bracket is grown downhill, and
//! Brent's method (Brent 1973, *Algorithms for Minimization without Derivatives*, chapter 5) narrows it.
//!
//! The evaluated points are part of the behaviour: where a function has several minima, they decide which one is found.

use std::ops::ControlFlow;

/// Ratio by which a bracket grows.
pub(super) const GROWTH: f64 = 1.618_034;
/// Largest step by parabolic extrapolation, as a multiple of the last step.
const LARGEST_STEP: f64 = 110.0;
/// Largest number of steps of a bracket.
const MAX_GROWTHS: usize = 1000;
/// Smallest denominator of a parabola.
const TINY: f64 = 1e-21;
/// Share of the golden section.
const GOLDEN_SHARE: f64 = 0.381_966_0;
/// Relative tolerance of the place of a minimum.
pub(super) const TOLERANCE: f64 = 1e-4;
/// Absolute tolerance of the place of a minimum.
const MIN_TOLERANCE: f64 = 1e-11;
/// Largest number of steps of Brent's method.
const MAX_STEPS: usize = 500;

/// A place and the value of the function there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CurvePoint {
    /// Place of the point.
    pub(super) x: f64,
    /// Value of the function there.
    pub(super) y: f64,
}

/// Three places in order, upwards or downwards; the middle one should have the least value.
#[derive(Debug, Clone, Copy)]
struct MinimumBracket([CurvePoint; 3]);

/// Searches for a minimum of a function from an interval; the result may lie outside of it. If no bracket is found, the result is the
/// lowest of the last three points, and NaN if one of them is.
pub(super) fn minimise(curve: impl Fn(f64) -> f64, interval: [f64; 2]) -> CurvePoint {
    let at = |x: f64| CurvePoint { x, y: curve(x) };
    let bracket = MinimumBracket::around(&at, interval);
    if bracket.is_valid() { BrentSearch::new(bracket).run(&at) } else { bracket.lowest() }
}

impl MinimumBracket {
    /// Goes downhill from an interval until the function rises.
    fn around(at: &impl Fn(f64) -> CurvePoint, [start, end]: [f64; 2]) -> Self {
        let (mut a, mut b) = (at(start), at(end));
        if a.y < b.y {
            (a, b) = (b, a);
        }
        let c = at(b.x + GROWTH * (b.x - a.x));
        let mut bracket = Self([a, b, c]);
        for _ in 0..=MAX_GROWTHS {
            let [_, b, c] = bracket.0;
            let falls = c.y < b.y;
            if !falls || bracket.grow(at).is_break() {
                break;
            }
        }
        bracket
    }

    /// Takes one step downhill: to the vertex of the parabola through the three points, if it is not too far.
    fn grow(&mut self, at: &impl Fn(f64) -> CurvePoint) -> ControlFlow<()> {
        let [a, b, c] = self.0;
        let beyond = |from: CurvePoint, to: CurvePoint| at(to.x + GROWTH * (to.x - from.x));
        let vertex = self.vertex();
        let limit = b.x + LARGEST_STEP * (c.x - b.x);
        let next = if (vertex - c.x) * (b.x - vertex) > 0.0 {
            let point = at(vertex);
            if point.y < c.y {
                self.0 = [b, point, c];
                return ControlFlow::Break(());
            }
            if point.y > b.y {
                self.0 = [a, b, point];
                return ControlFlow::Break(());
            }
            beyond(b, c)
        } else if (vertex - limit) * (limit - c.x) >= 0.0 {
            at(limit)
        } else if (vertex - limit) * (c.x - vertex) > 0.0 {
            let point = at(vertex);
            if point.y < c.y {
                self.0 = [c, point, beyond(c, point)];
                return ControlFlow::Continue(());
            }
            point
        } else {
            beyond(b, c)
        };
        self.0 = [b, c, next];
        ControlFlow::Continue(())
    }

    /// Place of the vertex of the parabola through the three points.
    fn vertex(&self) -> f64 {
        let [a, b, c] = self.0;
        let near = (b.x - a.x) * (b.y - c.y);
        let far = (b.x - c.x) * (b.y - a.y);
        let difference = far - near;
        let divisor = 2.0 * if difference.abs() < TINY { TINY } else { difference };
        b.x - ((b.x - c.x) * far - (b.x - a.x) * near) / divisor
    }

    fn is_valid(&self) -> bool {
        let [a, b, c] = self.0;
        let is_lowest = (b.y < c.y && b.y <= a.y) || (b.y < a.y && b.y <= c.y);
        let is_ordered = (a.x < b.x && b.x < c.x) || (c.x < b.x && b.x < a.x);
        is_lowest && is_ordered && self.0.iter().all(|point| point.x.is_finite())
    }

    fn lowest(&self) -> CurvePoint {
        let [a, b, c] = self.0;
        if self.0.iter().any(|point| point.x.is_nan() || point.y.is_nan()) {
            return CurvePoint { x: f64::NAN, y: f64::NAN };
        }
        let lower = |one: CurvePoint, other: CurvePoint| if other.y < one.y { other } else { one };
        lower(lower(a, b), c)
    }
}

/// State of Brent's method.
struct BrentSearch {
    /// Interval that contains the minimum.
    interval: [f64; 2],
    best: CurvePoint,
    second: CurvePoint,
    third: CurvePoint,
    /// The step before the last one.
    earlier_step: f64,
    step: f64,
}

impl BrentSearch {
    fn new(MinimumBracket([a, b, c]): MinimumBracket) -> Self {
        let interval = [a.x.min(c.x), a.x.max(c.x)];
        Self { interval, best: b, second: b, third: b, earlier_step: 0.0, step: 0.0 }
    }

    fn run(mut self, at: &impl Fn(f64) -> CurvePoint) -> CurvePoint {
        for _ in 0..MAX_STEPS {
            let [start, end] = self.interval;
            let tolerance = TOLERANCE * self.best.x.abs() + MIN_TOLERANCE;
            let middle = 0.5 * (start + end);
            if (self.best.x - middle).abs() < 2.0 * tolerance - 0.5 * (end - start) {
                break;
            }
            self.choose_step(middle, tolerance);
            let shortest = if self.step >= 0.0 { tolerance } else { -tolerance };
            let step = if self.step.abs() < tolerance { shortest } else { self.step };
            self.add(at(self.best.x + step));
        }
        self.best
    }

    /// Chooses the next step: to the vertex of the parabola through the three best points, or else by the golden section.
    fn choose_step(&mut self, middle: f64, tolerance: f64) {
        let [start, end] = self.interval;
        let x = self.best.x;
        if self.earlier_step.abs() > tolerance {
            let (second, third) = (self.second, self.third);
            let near = (x - second.x) * (self.best.y - third.y);
            let far = (x - third.x) * (self.best.y - second.y);
            let rise = (x - third.x) * far - (x - second.x) * near;
            let double = 2.0 * (far - near);
            let (rise, divisor) = if double > 0.0 { (-rise, double) } else { (rise, -double) };
            let half_earlier = (0.5 * divisor * self.earlier_step).abs();
            self.earlier_step = self.step;
            if rise > divisor * (start - x) && rise < divisor * (end - x) && rise.abs() < half_earlier {
                self.step = rise / divisor;
                let next = x + self.step;
                if next - start < 2.0 * tolerance || end - next < 2.0 * tolerance {
                    self.step = if middle >= x { tolerance } else { -tolerance };
                }
                return;
            }
        }
        self.earlier_step = if x >= middle { start - x } else { end - x };
        self.step = GOLDEN_SHARE * self.earlier_step;
    }

    /// Narrows the interval by a new point.
    fn add(&mut self, point: CurvePoint) {
        let is_before = point.x < self.best.x;
        if point.y > self.best.y {
            self.interval[usize::from(!is_before)] = point.x;
            if point.y <= self.second.y || self.second.x == self.best.x {
                (self.third, self.second) = (self.second, point);
            } else if point.y <= self.third.y || self.third.x == self.best.x || self.third.x == self.second.x
            {
                self.third = point;
            }
        } else {
            self.interval[usize::from(is_before)] = self.best.x;
            (self.third, self.second, self.best) = (self.second, self.best, point);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Asserts that a minimum is where SciPy 1.17 finds it with `minimize_scalar(curve, bracket=interval, tol=1e-4)`.
    fn assert_found(curve: impl Fn(f64) -> f64, interval: [f64; 2], x: f64, y: f64) {
        let found = minimise(curve, interval);
        assert!((found.x - x).abs() < 1e-9 * x.abs().max(1.0), "{interval:?}: {found:?}");
        assert!((found.y - y).abs() < 1e-12, "{interval:?}: {found:?}");
    }

    #[test]
    fn one_minimum_is_found_from_every_side() {
        let curve = |t: f64| (t - 400.0).abs() * (t - 400.0).abs().sqrt() / 1e4 - 0.3;
        assert_found(curve, [0.0, 1.0], 399.993_635_960_772_8, -0.299_999_949_230_922_5);
        assert_found(curve, [0.0, 30.0], 400.000_155_452_864_3, -0.299_999_999_806_180_2);
        assert_found(curve, [100.0, 700.0], 399.999_995_121_377_14, -0.299_999_999_998_922_4);
        assert_found(curve, [300.0, 310.0], 400.002_452_344_058_44, -0.299_999_987_855_710_8);
    }

    #[test]
    fn of_two_minima_the_points_decide() {
        let curve = |x: f64| (x - 3.0) * (x - 3.0) * ((x + 8.0) * (x + 8.0));
        assert_found(curve, [0.0, 30.0], 2.999_898_622_120_274, 1.243_551_492_345_512e-6);
        assert_found(curve, [-20.0, 90.0], -7.999_837_880_972_008, 3.180_098_348_453_576e-6);
    }

    #[test]
    fn a_minimum_outside_of_the_interval_is_found() {
        let curve = |x: f64| libm::sin(x) + 0.1 * x;
        assert_found(curve, [0.0, 1.0], -1.670_961_334_476_836_8, -1.162_083_811_899_367_7);
        assert_found(curve, [300.0, 310.0], 293.639_904_959_796_64, 28.368_887_800_453_3);
        let hill = |x: f64| 1e-3 * libm::cos(x) - libm::exp(-(x - 50.0) * (x - 50.0) / 30.0);
        assert_found(hill, [0.0, 30.0], 49.996_387_650_041_335, -0.999_035_553_086_207_8);
        assert_found(hill, [100.0, 700.0], 1_002.132_568_760_082_8, -0.000_999_370_376_412_183_8);
    }

    #[test]
    fn a_curve_that_levels_off_has_its_lowest_point() {
        assert_found(|x| libm::exp(-x), [0.0, 30.0], 1_360.576_518_429_472_6, 0.0);
    }

    #[test]
    fn a_curve_that_is_not_finite_has_no_minimum() {
        assert!(minimise(libm::sin, [f64::NAN, 1.0]).y.is_nan());
    }
}
