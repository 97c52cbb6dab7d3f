//! Geocentric position of the Sun: the harmonic series of ERFA's `epv00` (SOFA; Moisson and Bretagnon 2001, *Celest. Mech. Dyn.
//! Astron.* 80), terms of 1e-9 AU and more.

use std::sync::LazyLock;

use super::constants::ASTRONOMICAL_UNIT_M;
use super::vector3::Vector3;

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

/// A term of the series: amplitude · t^power · cos(phase + frequency · t), with t in Julian years since J2000.
struct Term {
    component: usize,
    power: usize,
    amplitude: f64,
    phase: f64,
    frequency: f64,
    /// Cosine and sine of the change of the angle between two nodes.
    cos_step: f64,
    sin_step: f64,
}

static TERMS: LazyLock<Vec<Term>> =
    LazyLock::new(|| include_str!("data/earth_series.txt").lines().filter_map(read_term).collect());

/// Reads a line of the data file: component, power, amplitude, phase and frequency.
fn read_term(line: &str) -> Option<Term> {
    let mut words = line.split(' ');
    let component = ["x", "y", "z"].iter().position(|name| Some(*name) == words.clone().next())?;
    words.next();
    let power = words.next()?.parse().ok()?;
    let mut number = || words.next().and_then(|word| word.parse::<f64>().ok());
    let (amplitude, phase, frequency) = (number()?, number()?, number()?);
    let (sin_step, cos_step) = libm::sincos(frequency * (NODE_S / YEAR_S));
    Some(Term { component, power, amplitude, phase, frequency, cos_step, sin_step })
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
        for term in TERMS.iter() {
            let (sin, cos) = libm::sincos(term.phase + term.frequency * years);
            let cosines =
                [cos * term.cos_step + sin * term.sin_step, cos, cos * term.cos_step - sin * term.sin_step];
            let mut time = years - step;
            for (node, cosine) in earth.iter_mut().zip(cosines) {
                let power = [1.0, time, time * time][term.power.min(2)];
                node[term.component] += term.amplitude * power * cosine;
                time += step;
            }
        }
        let [before, middle, after] = earth.map(|node| sun_from_earth(&node));
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
