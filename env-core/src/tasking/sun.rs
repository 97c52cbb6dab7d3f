//! Geocentric position of the Sun: the harmonic series of ERFA's `epv00` (SOFA; Moisson and Bretagnon 2001, *Celest. Mech. Dyn.
//! Astron.* 80), terms of 1e-9 AU and more, and a correction from 2000 to 2022.

use std::sync::LazyLock;

use pulp::{Arch, Simd, WithSimd};

use super::constants::ASTRONOMICAL_UNIT_M;
use super::sun_correction::sun_correction;
use super::vector3::{Vector3, add};

/// Seconds between the nodes of the interpolation. A parabola through three nodes errs by less than 300 m, 0.0004″.
pub const NODE_S: f64 = 14_400.0;
/// Seconds of a Julian year.
const YEAR_S: f64 = 86_400.0 * 365.25;
/// Rotation from the ecliptic of the series to the equator of J2000 (`epv00`, rows).
const EQUATOR_FROM_ECLIPTIC: [[f64; 3]; 3] = [
    [1.0, 0.000_000_211_284, -0.000_000_091_603],
    [-0.000_000_230_286, 0.917_482_137_087, -0.397_776_982_902],
    [0.0, 0.397_776_982_902, 0.917_482_137_087],
];

/// Terms that are evaluated together.
const TOGETHER: usize = 8;

/// Numbers of [`TOGETHER`] terms.
type TermLanes = [f64; TOGETHER];

/// Terms amplitude · t^power · cos(phase + frequency · t), with t in Julian years since J2000. Unused ones have no amplitude.
#[derive(Default)]
struct Terms {
    amplitude: TermLanes,
    phase: TermLanes,
    frequency: TermLanes,
    /// Cosine and sine of the change of the angle between two nodes.
    cos_step: TermLanes,
    sin_step: TermLanes,
}

/// Terms of one component and power of the time.
struct Series {
    component: usize,
    power: usize,
    terms: Vec<Terms>,
    /// Number of terms that are used.
    len: usize,
}

static SERIES: LazyLock<Vec<Series>> = LazyLock::new(|| {
    let mut all = Vec::new();
    for line in include_str!("data/earth_series.txt").lines() {
        read_term(line, &mut all);
    }
    all
});

/// Reads a line of the data file: component, power, amplitude, phase and frequency.
fn read_term(line: &str, all: &mut Vec<Series>) -> Option<()> {
    let mut words = line.split(' ');
    let component = ["x", "y", "z"].iter().position(|name| Some(*name) == words.clone().next())?;
    words.next();
    let power = words.next()?.parse().ok()?;
    let mut number = || words.next().and_then(|word| word.parse::<f64>().ok());
    let (amplitude, phase, frequency) = (number()?, number()?, number()?);
    if all.last().is_none_or(|series| (series.component, series.power) != (component, power)) {
        all.push(Series { component, power, terms: Vec::new(), len: 0 });
    }
    let series = all.last_mut()?;
    let lane = series.len % TOGETHER;
    if lane == 0 {
        series.terms.push(Terms::default());
    }
    series.len += 1;
    let terms = series.terms.last_mut()?;
    (terms.amplitude[lane], terms.phase[lane], terms.frequency[lane]) = (amplitude, phase, frequency);
    (terms.sin_step[lane], terms.cos_step[lane]) = libm::sincos(frequency * (NODE_S / YEAR_S));
    Some(())
}

/// Evaluation of a series at three nodes; its value is the sum of the terms without the power of the time at each.
struct SeriesSum<'a> {
    terms: &'a [Terms],
    /// Time of the middle node, Julian years since J2000.
    years: f64,
}

impl WithSimd for SeriesSum<'_> {
    type Output = [f64; 3];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> [f64; 3] {
        let (mut before, mut middle, mut after) = ([0.0; TOGETHER], [0.0; TOGETHER], [0.0; TOGETHER]);
        for terms in self.terms {
            let (sin, cos) = sines_and_cosines(terms, self.years);
            for i in 0..TOGETHER {
                let (by_cos, by_sin) = (cos[i] * terms.cos_step[i], sin[i] * terms.sin_step[i]);
                before[i] += terms.amplitude[i] * (by_cos + by_sin);
                middle[i] += terms.amplitude[i] * cos[i];
                after[i] += terms.amplitude[i] * (by_cos - by_sin);
            }
        }
        [before, middle, after].map(|lanes| lanes.iter().sum())
    }
}

/// Sines and cosines of the angles of terms, to 1e-12: the Taylor series of a fourth of the angle, doubled twice.
#[inline(always)]
fn sines_and_cosines(terms: &Terms, years: f64) -> (TermLanes, TermLanes) {
    /// Adding and subtracting this number rounds to a whole one.
    const ROUNDER: f64 = 6_755_399_441_055_744.0;
    const TURN: f64 = std::f64::consts::TAU;
    /// Difference of 2π and the number `TURN`.
    const TURN_REST: f64 = 2.449_293_598_294_706_4e-16;
    let (mut sin, mut cos) = ([0.0; TOGETHER], [0.0; TOGETHER]);
    for i in 0..TOGETHER {
        let angle = terms.phase[i] + terms.frequency[i] * years;
        let turns = (angle * (1.0 / TURN) + ROUNDER) - ROUNDER;
        let quarter = ((angle - turns * TURN) - turns * TURN_REST) * 0.25;
        let z = quarter * quarter;
        let mut s = 1.0 - z * (1.0 / 210.0);
        let mut c = 1.0 - z * (1.0 / 182.0);
        for [odd, even] in
            [[156.0, 132.0], [110.0, 90.0], [72.0, 56.0], [42.0, 30.0], [20.0, 12.0], [6.0, 2.0]]
        {
            s = 1.0 - z * (1.0 / odd) * s;
            c = 1.0 - z * (1.0 / even) * c;
        }
        s *= quarter;
        for _ in 0..2 {
            (s, c) = (2.0 * s * c, 1.0 - 2.0 * s * s);
        }
        (sin[i], cos[i]) = (s, c);
    }
    (sin, cos)
}

/// Three positions of the Sun, [`NODE_S`] apart, and the parabola through them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SunArc {
    /// Coefficients of 1, s and s² with s = (time − middle)/[`NODE_S`], m.
    coefficients: [Vector3<f64>; 3],
}

impl SunArc {
    /// Evaluates the series around the middle of two node intervals. `start_tdb_s` is the time of the first node.
    #[must_use]
    pub fn starting_at(start_tdb_s: f64) -> Self {
        let years = (start_tdb_s + NODE_S) / YEAR_S;
        let step = NODE_S / YEAR_S;
        let mut earth = [[0.0; 3]; 3];
        for series in SERIES.iter() {
            let sums = Arch::new().dispatch(SeriesSum { terms: &series.terms, years });
            let mut time = years - step;
            for (node, sum) in earth.iter_mut().zip(sums) {
                let power = [1.0, time, time * time][series.power.min(2)];
                node[series.component] += power * sum;
                time += step;
            }
        }
        let mut time_s = start_tdb_s;
        let [before, middle, after] = earth.map(|node| {
            let sun = add(&sun_from_earth(&node), &sun_correction(time_s));
            time_s += NODE_S;
            sun
        });
        let coefficient = |f: fn(f64, f64, f64) -> f64| [0, 1, 2].map(|i| f(before[i], middle[i], after[i]));
        Self {
            coefficients: [
                middle,
                coefficient(|before, _, after| (after - before) * 0.5),
                coefficient(|before, middle, after| (after + before) * 0.5 - middle),
            ],
        }
    }

    /// Position of the Sun relative to the Earth in the inertial frame, m, `seconds` after the first node.
    #[must_use]
    pub fn position(&self, seconds: f64) -> Vector3<f64> {
        let s = (seconds - NODE_S) / NODE_S;
        let [a, b, c] = &self.coefficients;
        [0, 1, 2].map(|i| a[i] + s * (b[i] + s * c[i]))
    }
}

/// Geocentric Sun on the equator of J2000, m, from the heliocentric Earth on the ecliptic, AU.
fn sun_from_earth(earth: &Vector3<f64>) -> Vector3<f64> {
    super::vector3::rotate(&EQUATOR_FROM_ECLIPTIC, earth).map(|x| -x * ASTRONOMICAL_UNIT_M)
}
