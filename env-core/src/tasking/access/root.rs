//! Root of a function between two places where its signs differ, as SciPy's `brentq` finds it: Brent's method with inverse quadratic
//! interpolation (Brent 1973, *Algorithms for Minimization without Derivatives*, chapter 4).
//!
//! The evaluated points are part of the behaviour: where a function has several roots, they decide which one is found.

use super::minimum::CurvePoint;

/// Absolute tolerance of a root.
const ABSOLUTE: f64 = 2e-12;
/// Relative tolerance of a root.
const RELATIVE: f64 = 4.0 * f64::EPSILON;
/// Largest number of steps.
const MAX_STEPS: usize = 100;

/// Finds a root between two places where the signs of a function differ.
pub(super) fn find_root(curve: impl Fn(f64) -> f64, ends: [f64; 2]) -> f64 {
    let [mut previous, mut current] = ends.map(|x| CurvePoint { x, y: curve(x) });
    if previous.y == 0.0 {
        return previous.x;
    }
    // The point on the other side of the root.
    let mut opposite = previous;
    let (mut earlier_step, mut step) = (0.0, 0.0);
    for _ in 0..MAX_STEPS {
        if current.y != 0.0 && previous.y != 0.0 && differ_in_sign(&previous, &current) {
            opposite = previous;
            step = current.x - previous.x;
            earlier_step = step;
        }
        if opposite.y.abs() < current.y.abs() {
            (previous, current, opposite) = (current, opposite, current);
        }
        let tolerance = 0.5 * (ABSOLUTE + RELATIVE * current.x.abs());
        let half = 0.5 * (opposite.x - current.x);
        if current.y == 0.0 || half.abs() < tolerance {
            break;
        }
        let is_converging = earlier_step.abs() > tolerance && current.y.abs() < previous.y.abs();
        let guess = is_converging.then(|| interpolate(&previous, &current, &opposite));
        let largest = earlier_step.abs().min(3.0 * half.abs() - tolerance);
        (earlier_step, step) = match guess {
            Some(guess) if 2.0 * guess.abs() < largest => (step, guess),
            _ => (half, half),
        };
        previous = current;
        let x = current.x + if step.abs() > tolerance { step } else { tolerance.copysign(half) };
        current = CurvePoint { x, y: curve(x) };
    }
    current.x
}

fn differ_in_sign(one: &CurvePoint, other: &CurvePoint) -> bool {
    one.y.is_sign_negative() != other.y.is_sign_negative()
}

/// Step from the current point to the root of a secant, or of the inverse parabola through three points.
fn interpolate(previous: &CurvePoint, current: &CurvePoint, opposite: &CurvePoint) -> f64 {
    if previous.x == opposite.x {
        return -current.y * (current.x - previous.x) / (current.y - previous.y);
    }
    let slope_to = |point: &CurvePoint| (point.y - current.y) / (point.x - current.x);
    let (before, across) = (slope_to(previous), slope_to(opposite));
    -current.y * (opposite.y * across - previous.y * before) / (across * before * (opposite.y - previous.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_several_roots_the_points_decide() {
        // Those that SciPy 1.17 finds with `root_scalar(curve, bracket=ends)`.
        let cubic = |x: f64| (x - 1.0) * (x - 2.0) * (x - 4.0);
        let ends_and_roots = [([0.0, 2.0], 2.0), ([0.0, 100.0], 1.0), ([-5.0, 10.0], 2.0), ([1.0, 8.0], 1.0)];
        for (ends, root) in ends_and_roots {
            assert!((find_root(cubic, ends) - root).abs() < 1e-11, "{ends:?}");
        }
        let ends_and_roots = [([0.0, 2.0], 1.0), ([3.0, 0.0], 1.0), ([-5.0, 10.0], 1.0), ([1.0, 8.0], 5.0)];
        for (ends, quarter_turns) in ends_and_roots {
            let root = quarter_turns * std::f64::consts::FRAC_PI_2;
            assert!((find_root(libm::cos, ends) - root).abs() < 1e-11, "{ends:?}");
        }
    }

    #[test]
    fn a_steep_curve_has_its_root_within_a_hundred_steps() {
        let mut evaluated = std::cell::Cell::new(0);
        let steep = |x: f64| {
            evaluated.set(evaluated.get() + 1);
            libm::tanh(1e3 * (x - 0.3)) + 1e-3
        };
        assert!((find_root(steep, [0.0, 100.0]) - 0.299_998_999_999_603_67).abs() < 1e-11);
        assert_eq!(*evaluated.get_mut(), 22);
    }
}
