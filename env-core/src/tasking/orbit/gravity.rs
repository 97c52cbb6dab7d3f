//! Gravity of the Earth and the Sun.
//!
//! The spherical harmonics are Pines' nonsingular form with normalised coefficients (Pines 1973, *AIAA Journal* 11(11), 1508–1511;
//! recursions of Lundberg and Schutz 1988, *J. Guidance* 11(1), 32–38) with GGM03S to degree and order 10.

use std::sync::LazyLock;

use pulp::{Arch, Simd, WithSimd};

use crate::tasking::constants::{EARTH_MU, EARTH_RADIUS_M, SUN_MU};
use crate::tasking::earth::{EARTH_RATE_RAD_S, EarthFrame};
use crate::tasking::vector3::{Matrix3, Vector3, add, dot, norm, rotate, rotate_back, scale, sub};

/// Degree and order of the field.
const DEGREE: usize = 10;
/// Number of orders that the recursions need: one beyond the field's.
const ORDERS: usize = DEGREE + 2;
/// Length of a row of values by order: beyond [`ORDERS`] they are zero, so that rows can be read one order ahead.
const ROW: usize = 16;

/// Gravity model of a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum GravityModel {
    /// GGM03S to degree and order 10, and the Sun: the forces of BSK-RL.
    #[default]
    Ggm10,
    /// Point mass and oblateness J₂.
    J2,
    /// A point mass only.
    Kepler,
}

impl GravityModel {
    /// Reads the name of an option: `ggm10`, `j2` or `kepler`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        [("ggm10", Self::Ggm10), ("j2", Self::J2), ("kepler", Self::Kepler)]
            .into_iter()
            .find_map(|(known, gravity)| (known == name).then_some(gravity))
    }

    /// Acceleration in the inertial frame, m/s². `frame` is the Earth's orientation, `sun` the Sun's position, m, and `step_s` the
    /// step with which Basilisk integrates (see [`stretch_acceleration`]).
    #[must_use]
    pub fn acceleration(
        self,
        position: &Vector3<f64>,
        frame: &EarthFrame,
        sun: &Vector3<f64>,
        step_s: f64,
    ) -> Vector3<f64> {
        match self {
            Self::Kepler => {
                let r2 = dot(position, position);
                scale(position, -EARTH_MU / (r2 * r2.sqrt()))
            }
            Self::J2 => earth_acceleration::<2, 0>(position, frame),
            Self::Ggm10 => {
                let earth = earth_acceleration::<DEGREE, DEGREE>(position, frame);
                let stretched = stretch_acceleration(position, &frame.equator, mean_stretch(step_s));
                add(&add(&earth, &stretched), &sun_acceleration(position, sun))
            }
        }
    }
}

/// Attraction of the Earth in the inertial frame.
fn earth_acceleration<const N: usize, const ORDER: usize>(
    position: &Vector3<f64>,
    frame: &EarthFrame,
) -> Vector3<f64> {
    let matrix = frame.planet_from_inertial();
    let harmonics = Harmonics::<N, ORDER> { position: rotate(&matrix, position) };
    rotate_back(&matrix, &Arch::new().dispatch(harmonics))
}

/// Error of Basilisk's attraction of the Earth, m/s².
///
/// Within a step, Basilisk extrapolates the rotation matrix of the Earth linearly. After a time t it stretches vectors along the
/// equator by √(1 + stretch), with stretch = (ωt)², and gravity is computed from the stretched position. With steps of 1 s this
/// moves a satellite by decimetres in a day, with the 30 s of the trajectory that BSK-RL searches for windows by 60 m in an orbit.
#[must_use]
pub fn stretch_acceleration(position: &Vector3<f64>, equator: &Matrix3<f64>, stretch: f64) -> Vector3<f64> {
    let radius_2 = dot(position, position);
    let height = dot(&equator[2], position);
    let factor = -EARTH_MU / (radius_2 * radius_2.sqrt()) * stretch;
    let share = 1.5 * (1.0 - height * height / radius_2);
    let along_equator = sub(position, &scale(&equator[2], height));
    scale(&sub(&along_equator, &scale(position, share)), factor)
}

/// Mean stretch over the stages of RK4 with steps of `step_s` seconds.
fn mean_stretch(step_s: f64) -> f64 {
    let turn = EARTH_RATE_RAD_S * step_s;
    turn * turn / 3.0
}

/// Attraction of the Sun on the satellite less that on the Earth (Montenbruck and Gill 2000, *Satellite Orbits*, eq. 3.37).
fn sun_acceleration(position: &Vector3<f64>, sun: &Vector3<f64>) -> Vector3<f64> {
    let to_sun = sub(sun, position);
    let (near, far) = (dot(&to_sun, &to_sun), dot(sun, sun));
    sub(&scale(&to_sun, SUN_MU / (near * near.sqrt())), &scale(sun, SUN_MU / (far * far.sqrt())))
}

/// Values of one order of the field for each degree, side by side, so that the compiler can use SIMD.
type Orders = [f64; ROW];

/// Factors of the recursions and sums, by degree and order.
struct Factors {
    cos: [Orders; ORDERS],
    sin: [Orders; ORDERS],
    diagonal: Orders,
    subdiagonal: Orders,
    n1: [Orders; ORDERS],
    n2: [Orders; ORDERS],
    q1: [Orders; ORDERS],
    q2: [Orders; ORDERS],
}

static FACTORS: LazyLock<Factors> = LazyLock::new(Factors::new);

impl Factors {
    fn new() -> Self {
        let zero = [[0.0; ROW]; ORDERS];
        let mut factors = Self {
            cos: zero,
            sin: zero,
            diagonal: [0.0; ROW],
            subdiagonal: [0.0; ROW],
            n1: zero,
            n2: zero,
            q1: zero,
            q2: zero,
        };
        factors.read_coefficients(include_str!("../data/ggm03s.txt"));
        let weight = |order: usize| if order == 0 { 1.0 } else { 2.0 };
        factors.diagonal[0] = 1.0;
        for l in 1..ORDERS {
            let degree = l as f64;
            factors.diagonal[l] = ((2.0 * degree + 1.0) * weight(l) / (2.0 * degree * weight(l - 1))).sqrt()
                * factors.diagonal[l - 1];
            factors.subdiagonal[l] = (2.0 * degree * weight(l - 1) / weight(l)).sqrt() * factors.diagonal[l];
        }
        for l in 0..ORDERS {
            for m in 0..=l {
                let (d, o) = (l as f64, m as f64);
                if l >= m + 2 {
                    factors.n1[l][m] = ((2.0 * d + 1.0) * (2.0 * d - 1.0) / ((d - o) * (d + o))).sqrt();
                    factors.n2[l][m] = ((d + o - 1.0) * (2.0 * d + 1.0) * (d - o - 1.0)
                        / ((d + o) * (d - o) * (2.0 * d - 3.0)))
                        .sqrt();
                }
                if m < l {
                    factors.q1[l][m] = ((d - o) * weight(m) * (d + o + 1.0) / weight(m + 1)).sqrt();
                }
                factors.q2[l][m] = ((d + o + 2.0) * (d + o + 1.0) * (2.0 * d + 1.0) * weight(m)
                    / ((2.0 * d + 3.0) * weight(m + 1)))
                .sqrt();
            }
        }
        factors
    }

    fn read_coefficients(&mut self, text: &str) {
        for line in text.lines().filter(|line| !line.starts_with('#')) {
            let words: Vec<&str> = line.split(' ').collect();
            if let [degree, order, cos, sin] = words[..]
                && let (Ok(l), Ok(m)) = (degree.parse::<usize>(), order.parse::<usize>())
                && let (Ok(cos), Ok(sin)) = (cos.parse(), sin.parse())
            {
                (self.cos[l][m], self.sin[l][m]) = (cos, sin);
            }
        }
    }
}

/// Spherical harmonics to degree `N` and order `ORDER` at a planet-fixed position, m. Their value is the acceleration, m/s².
struct Harmonics<const N: usize, const ORDER: usize> {
    position: Vector3<f64>,
}

impl<const N: usize, const ORDER: usize> WithSimd for Harmonics<N, ORDER> {
    type Output = Vector3<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vector3<f64> {
        harmonics::<N, ORDER>(&self.position)
    }
}

/// Acceleration in the planet-fixed frame, m/s², to degree `N` and order `ORDER`.
#[inline(always)]
fn harmonics<const N: usize, const ORDER: usize>(position: &Vector3<f64>) -> Vector3<f64> {
    let factors = &*FACTORS;
    let radius = norm(position);
    let [s, t, u] = position.map(|x| x / radius);
    let (real, imaginary) = powers(s, t, ORDER);
    let powers = [real, imaginary, ahead(&real), ahead(&imaginary)];
    let ratio = EARTH_RADIUS_M / radius;
    let mut strength = EARTH_MU / radius * ratio;
    let mut sums = [[0.0; ROW]; 4];
    let point_mass = -strength / EARTH_RADIUS_M;
    let mut legendre = [[0.0; ROW]; ORDERS];
    legendre[0][0] = factors.diagonal[0];
    fill_legendre(factors, &mut legendre, 1, u);
    for l in 1..=N {
        fill_legendre(factors, &mut legendre, l + 1, u);
        strength *= ratio;
        let factor = strength / EARTH_RADIUS_M;
        let (current, next) = (&legendre[l], &legendre[l + 1]);
        let degree = DegreeFactors {
            cos: up_to(&factors.cos[l], ORDER),
            sin: up_to(&factors.sin[l], ORDER),
            current,
            current_ahead: &ahead(current),
            next_ahead: &ahead(next),
            q1: &factors.q1[l],
            q2: &factors.q2[l],
            factor,
        };
        degree.add_to(&mut sums, &powers);
    }
    let [a1, a2, a3, a4] = sums.map(|orders| orders.iter().sum::<f64>());
    let radial = point_mass - a4;
    [a1 + s * radial, a2 + t * radial, a3 + u * radial]
}

/// The orders of a row as floating-point numbers.
const ORDER_NUMBERS: Orders =
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];

/// Values of one degree, by order.
struct DegreeFactors<'a> {
    cos: Orders,
    sin: Orders,
    current: &'a Orders,
    current_ahead: &'a Orders,
    next_ahead: &'a Orders,
    q1: &'a Orders,
    q2: &'a Orders,
    factor: f64,
}

impl DegreeFactors<'_> {
    /// Adds the terms of the degree. The loops are apart from each other so that the compiler uses SIMD for each.
    #[inline(always)]
    fn add_to(&self, sums: &mut [Orders; 4], [real, imaginary, real_ahead, imaginary_ahead]: &[Orders; 4]) {
        let (mut d, mut weighted) = ([0.0; ROW], [0.0; ROW]);
        for m in 0..ROW {
            d[m] = self.cos[m] * real_ahead[m] + self.sin[m] * imaginary_ahead[m];
        }
        for m in 0..ROW {
            weighted[m] = self.factor * ORDER_NUMBERS[m] * self.current[m];
        }
        for m in 0..ROW {
            sums[0][m] += weighted[m] * (self.cos[m] * real[m] + self.sin[m] * imaginary[m]);
        }
        for m in 0..ROW {
            sums[1][m] += weighted[m] * (self.sin[m] * real[m] - self.cos[m] * imaginary[m]);
        }
        for m in 0..ROW {
            sums[2][m] += self.factor * self.q1[m] * self.current_ahead[m] * d[m];
        }
        for m in 0..ROW {
            sums[3][m] += self.factor * self.q2[m] * self.next_ahead[m] * d[m];
        }
    }
}

/// A row from the next order on.
#[inline(always)]
fn ahead(row: &Orders) -> Orders {
    let mut moved = [0.0; ROW];
    moved[..ROW - 1].copy_from_slice(&row[1..]);
    moved
}

/// A row without the orders beyond `order`.
#[inline(always)]
fn up_to(row: &Orders, order: usize) -> Orders {
    let mut kept = *row;
    kept[order + 1..].fill(0.0);
    kept
}

/// Real and imaginary parts of (s + i·t)^(m − 1) at index m; those of index 0 are zero.
#[inline(always)]
fn powers(s: f64, t: f64, order: usize) -> (Orders, Orders) {
    let (mut real, mut imaginary) = ([0.0; ROW], [0.0; ROW]);
    real[1] = 1.0;
    for m in 2..=order + 1 {
        real[m] = s * real[m - 1] - t * imaginary[m - 1];
        imaginary[m] = s * imaginary[m - 1] + t * real[m - 1];
    }
    (real, imaginary)
}

/// Computes the derived Legendre functions of a degree from those of the two degrees below.
#[inline(always)]
fn fill_legendre(factors: &Factors, legendre: &mut [Orders; ORDERS], l: usize, u: f64) {
    let (below, two_below) = (legendre[l - 1], if l > 1 { legendre[l - 2] } else { [0.0; ROW] });
    let row = &mut legendre[l];
    for m in 0..ROW {
        row[m] = u * factors.n1[l][m] * below[m] - factors.n2[l][m] * two_below[m];
    }
    row[l - 1] = factors.subdiagonal[l] * u;
    row[l] = factors.diagonal[l];
}
