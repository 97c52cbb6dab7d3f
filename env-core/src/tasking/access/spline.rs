//! Cubic spline through samples at equal distances of time.
//!
//! The ends are those of SciPy's `interp1d`: the third derivative is continuous at the second and at the last but one sample (de Boor
//! 1978, *A Practical Guide to Splines*, chapter IV). Beyond the ends, the first and the last polynomial go on.

use crate::tasking::vector3::{Vector3, add, scale, sub};

/// Fewest samples of a spline.
const MIN_SAMPLES: usize = 4;
/// Number of samples after which a change of the spline's end is smaller than rounding: each sample reduces it by 2 + √3.
const END_EFFECT: usize = 48;

/// Cubic spline through positions.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct UniformSpline {
    /// Time between two samples, s.
    spacing_s: f64,
    samples: Vec<Vector3<f64>>,
    /// Second derivatives at the samples, m/s².
    curvatures: Vec<Vector3<f64>>,
}

impl UniformSpline {
    /// Creates a spline without samples. `spacing_s` is the time between two of them, s.
    pub(super) const fn new(spacing_s: f64) -> Self {
        Self { spacing_s, samples: Vec::new(), curvatures: Vec::new() }
    }

    /// Samples so far, m.
    pub(super) fn samples(&self) -> &[Vector3<f64>] {
        &self.samples
    }

    /// Appends samples. There must be four or more in all.
    pub(super) fn extend(&mut self, samples: impl Iterator<Item = Vector3<f64>>) {
        let known = self.samples.len();
        self.samples.extend(samples);
        if self.samples.len() > known.max(MIN_SAMPLES - 1) {
            let first = known.saturating_sub(2 + END_EFFECT).max(1);
            self.compute_curvatures(first);
        }
    }

    /// Six times the second difference at a sample over the square of the spacing.
    fn difference(&self, index: usize) -> Vector3<f64> {
        let [before, here, after] = [0, 1, 2].map(|i| self.samples[index + i - 1]);
        let factor = 6.0 / (self.spacing_s * self.spacing_s);
        [0, 1, 2].map(|i| factor * ((before[i] - here[i]) + (after[i] - here[i])))
    }

    /// Computes the curvatures after a sample by elimination; that of the sample itself must be known, unless it is the second one.
    fn compute_curvatures(&mut self, first: usize) {
        let last = self.samples.len() - 2;
        self.curvatures.resize(last + 2, [0.0; 3]);
        // The condition at an end makes the curvature next to it a third of those around it, which gives it alone.
        for index in [1, last] {
            if index == last || first == 1 {
                self.curvatures[index] = scale(&self.difference(index), 1.0 / 6.0);
            }
        }
        let mut shares = vec![0.0];
        for index in first + 1..last {
            let share = 1.0 / (4.0 - shares[index - first - 1]);
            let rest = sub(&self.difference(index), &self.curvatures[index - 1]);
            self.curvatures[index] = scale(&rest, share);
            shares.push(share);
        }
        for index in (first + 1..last).rev() {
            let next = scale(&self.curvatures[index + 1], shares[index - first]);
            self.curvatures[index] = sub(&self.curvatures[index], &next);
        }
        let beyond = |near: &Vector3<f64>, far: &Vector3<f64>| sub(&add(near, near), far);
        self.curvatures[0] = beyond(&self.curvatures[1], &self.curvatures[2]);
        self.curvatures[last + 1] = beyond(&self.curvatures[last], &self.curvatures[last - 1]);
    }

    /// Position at a time since the first sample, m; the time may lie outside the samples.
    pub(super) fn position(&self, seconds: f64) -> Vector3<f64> {
        let step = self.spacing_s;
        let index = ((seconds / step) as usize).min(self.samples.len() - 2);
        let time = seconds - index as f64 * step;
        [0, 1, 2].map(|i| {
            let [from, to] = [self.samples[index][i], self.samples[index + 1][i]];
            let [bend, next_bend] = [self.curvatures[index][i], self.curvatures[index + 1][i]];
            let slope = (to - from) / step - step * (2.0 * bend + next_bend) / 6.0;
            from + time * (slope + time * (0.5 * bend + time * (next_bend - bend) / (6.0 * step)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of SciPy 1.17 for `interp1d(30·[0…7], y, kind="cubic", fill_value="extrapolate")` with y = sin(k²) and cos(k).
    fn example() -> UniformSpline {
        let mut spline = UniformSpline::new(30.0);
        spline.extend((0..8).map(|k| [libm::sin(f64::from(k * k)), libm::cos(f64::from(k)), 0.0]));
        spline
    }

    /// Times, and the values of both components.
    const EXPECTED: [[f64; 3]; 11] = [
        [-400.0, -4_385.276_186_372_521, -492.235_221_440_182_3],
        [-10.0, -2.288_099_548_962_321, 0.882_920_192_004_024_3],
        [0.0, 0.0, 1.0],
        [11.0, 1.127_806_865_759_544_6, 0.947_614_437_917_627_9],
        [44.0, -0.116_613_540_038_891_07, 0.099_484_377_733_726_48],
        [75.0, -0.230_231_224_716_602_87, -0.797_245_761_492_900_3],
        [133.3, -0.272_542_816_936_966_75, -0.263_369_835_429_057_34],
        [195.0, -1.300_185_783_278_622_3, 1.000_658_950_823_691_6],
        [209.0, -1.005_851_789_469_068_6, 0.780_623_536_137_680_3],
        [260.0, 10.457_533_572_783_142, -2.997_656_071_625_779],
        [1500.0, 49_717.391_082_706_09, -8_398.128_518_264_45],
    ];

    #[test]
    fn the_spline_has_the_values_of_scipy() {
        let spline = example();
        for [seconds, sine, cosine] in EXPECTED {
            let [x, y, _] = spline.position(seconds);
            let tolerance = |value: f64| 1e-11 * value.abs().max(1.0);
            assert!((x - sine).abs() < tolerance(sine), "{seconds}: {x}");
            assert!((y - cosine).abs() < tolerance(cosine), "{seconds}: {y}");
        }
    }

    #[test]
    fn a_cubic_polynomial_is_its_own_spline() {
        let cubic = |t: f64| 3.0 - 0.2 * t + 4e-3 * t * t - 1e-5 * t * t * t;
        for count in [4, 5, 6, 40] {
            let mut spline = UniformSpline::new(30.0);
            spline.extend((0..count).map(|k| [cubic(30.0 * f64::from(k)), 0.0, 0.0]));
            for seconds in [-500.0, -1.0, 0.0, 17.0, 45.0, 89.0, 400.0, 2000.0] {
                let error = spline.position(seconds)[0] - cubic(seconds);
                assert!(error.abs() < 1e-6, "{count} samples, {seconds} s: {error:e}");
            }
        }
    }

    #[test]
    fn samples_that_come_later_give_the_same_spline() {
        let sample = |k: usize| [libm::sin(k as f64), libm::cos(0.3 * k as f64), 1.0];
        let mut whole = UniformSpline::new(30.0);
        whole.extend((0..300).map(sample));
        let mut parts = UniformSpline::new(30.0);
        for ends in [0, 5, 6, 7, 60, 64, 130, 300].windows(2) {
            parts.extend((ends[0]..ends[1]).map(sample));
        }
        for (one, other) in whole.curvatures.iter().zip(&parts.curvatures) {
            assert!(one.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-15), "{one:?}, {other:?}");
        }
    }
}
