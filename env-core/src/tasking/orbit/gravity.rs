//! Gravity of the Earth and the Sun.
//!
//! The spherical harmonics are Pines' nonsingular form with normalised coefficients (Pines 1973, *AIAA Journal* 11(11), 1508–1511;
//! recursions of Lundberg and Schutz 1988, *J. Guidance* 11(1), 32–38) with GGM03S to degree and order 10.

use std::sync::LazyLock;

use pulp::{Arch, Simd, WithSimd};

use crate::tasking::constants::{EARTH_MU, EARTH_RADIUS_M, SUN_MU};
use crate::tasking::earth::{EARTH_RATE_RAD_S, EarthFrame};
use crate::tasking::pack::Pack;
use crate::tasking::real::Real;
use crate::tasking::vector3::{Matrix3, Vector3, add, dot, norm, rotate, rotate_back, scale, sub};

/// Degree and order of the field.
const DEGREE: usize = 10;
/// Length of a row of values by order; those beyond one degree more than the field's are zero.
const ROW: usize = 16;
/// Half of a row, which holds the orders of a degree below it.
const HALF_ROW: usize = ROW / 2;

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
            Self::J2 => earth_acceleration(&OBLATENESS, position, frame),
            Self::Ggm10 => {
                let earth = earth_acceleration(&GGM03S, position, frame);
                let stretched = stretch_acceleration(position, &frame.equator, mean_stretch(step_s));
                add(&add(&earth, &stretched), &sun_acceleration(position, sun))
            }
        }
    }
}

/// Attraction of the Earth in the inertial frame.
fn earth_acceleration(field: &'static Field, position: &Vector3<f64>, frame: &EarthFrame) -> Vector3<f64> {
    let matrix = frame.planet_from_inertial();
    let harmonics = Harmonics { field, position: rotate(&matrix, position) };
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
#[must_use]
pub fn mean_stretch(step_s: f64) -> f64 {
    let turn = EARTH_RATE_RAD_S * step_s;
    turn * turn / 3.0
}

/// Attraction of the Sun on the satellite less that on the Earth (Montenbruck and Gill 2000, *Satellite Orbits*, eq. 3.37).
fn sun_acceleration(position: &Vector3<f64>, sun: &Vector3<f64>) -> Vector3<f64> {
    let to_sun = sub(sun, position);
    let (near, far) = (dot(&to_sun, &to_sun), dot(sun, sun));
    sub(&scale(&to_sun, SUN_MU / (near * near.sqrt())), &scale(sun, SUN_MU / (far * far.sqrt())))
}

/// Values of one degree of the field for each order, side by side, so that the compiler can use SIMD.
type Orders = [f64; ROW];

/// The field to degree and order 10.
static GGM03S: LazyLock<Field> = LazyLock::new(|| Field::new(DEGREE, DEGREE));
/// The field of an oblate Earth: degree 2 and order 0.
static OBLATENESS: LazyLock<Field> = LazyLock::new(|| Field::new(2, 0));

/// Factors of the recursions and sums of a field.
struct Field {
    /// Degree 1 and on, to one degree beyond the last one that is summed.
    degrees: Vec<Degree>,
}

/// Factors of one degree, by order.
struct Degree {
    cos: Orders,
    sin: Orders,
    order_cos: Orders,
    order_sin: Orders,
    q1: Orders,
    q2: Orders,
    legendre: Recursion,
    /// The recursion of the next order, at the same index.
    legendre_ahead: Recursion,
}

/// Recursion of derived Legendre functions from the two degrees below.
struct Recursion {
    n1: Orders,
    n2: Orders,
    diagonal: Orders,
    subdiagonal: Orders,
}

impl Field {
    fn new(degree: usize, order: usize) -> Self {
        let weight = |order: usize| if order == 0 { 1.0 } else { 2.0 };
        let mut diagonal = 1.0;
        let mut degrees = Vec::with_capacity(degree + 1);
        for l in 1..=degree + 1 {
            let d = l as f64;
            diagonal *= ((2.0 * d + 1.0) * weight(l) / (2.0 * d * weight(l - 1))).sqrt();
            let subdiagonal = (2.0 * d * weight(l - 1) / weight(l)).sqrt() * diagonal;
            degrees.push(Degree::new(l, diagonal, subdiagonal));
        }
        let mut field = Self { degrees };
        field.read_coefficients(include_str!("../data/ggm03s.txt"), degree, order);
        field
    }

    fn read_coefficients(&mut self, text: &str, last_degree: usize, last_order: usize) {
        for line in text.lines().filter(|line| !line.starts_with('#')) {
            let words: Vec<&str> = line.split(' ').collect();
            if let [degree, order, cos, sin] = words[..]
                && let (Ok(l), Ok(m)) = (degree.parse::<usize>(), order.parse::<usize>())
                && let (Ok(cos), Ok(sin)) = (cos.parse::<f64>(), sin.parse::<f64>())
                && (1..=last_degree).contains(&l)
                && m <= last_order
            {
                let (row, order) = (&mut self.degrees[l - 1], m as f64);
                (row.cos[m], row.sin[m]) = (cos, sin);
                (row.order_cos[m], row.order_sin[m]) = (order * cos, order * sin);
            }
        }
    }
}

impl Degree {
    fn new(l: usize, diagonal: f64, subdiagonal: f64) -> Self {
        let weight = |order: usize| if order == 0 { 1.0 } else { 2.0 };
        let zero = [0.0; ROW];
        let mut legendre = Recursion { n1: zero, n2: zero, diagonal: zero, subdiagonal: zero };
        let (mut q1, mut q2) = (zero, zero);
        legendre.diagonal[l] = diagonal;
        legendre.subdiagonal[l - 1] = subdiagonal;
        for m in 0..=l {
            let (d, o) = (l as f64, m as f64);
            if l >= m + 2 {
                legendre.n1[m] = ((2.0 * d + 1.0) * (2.0 * d - 1.0) / ((d - o) * (d + o))).sqrt();
                legendre.n2[m] = ((d + o - 1.0) * (2.0 * d + 1.0) * (d - o - 1.0)
                    / ((d + o) * (d - o) * (2.0 * d - 3.0)))
                    .sqrt();
            }
            if m < l {
                q1[m] = ((d - o) * weight(m) * (d + o + 1.0) / weight(m + 1)).sqrt();
            }
            q2[m] = ((d + o + 2.0) * (d + o + 1.0) * (2.0 * d + 1.0) * weight(m)
                / ((2.0 * d + 3.0) * weight(m + 1)))
            .sqrt();
        }
        let legendre_ahead = legendre.ahead();
        Self { cos: zero, sin: zero, order_cos: zero, order_sin: zero, q1, q2, legendre, legendre_ahead }
    }
}

impl Recursion {
    /// The recursion with each order at the index of the one before.
    fn ahead(&self) -> Self {
        let ahead = |row: &Orders| {
            let mut moved = [0.0; ROW];
            moved[..ROW - 1].copy_from_slice(&row[1..]);
            moved
        };
        Self {
            n1: ahead(&self.n1),
            n2: ahead(&self.n2),
            diagonal: ahead(&self.diagonal),
            subdiagonal: ahead(&self.subdiagonal),
        }
    }

    /// The first functions of a degree, those of `N` registers, from those of the two degrees below.
    #[inline(always)]
    fn next<S: Simd, const N: usize>(
        &self,
        simd: S,
        below: &Pack<S, N>,
        two_below: &Pack<S, N>,
        u: f64,
    ) -> Pack<S, N> {
        (load::<S, N>(simd, &self.n1) * *below + load::<S, N>(simd, &self.subdiagonal)).times(u)
            - load::<S, N>(simd, &self.n2) * *two_below
            + load::<S, N>(simd, &self.diagonal)
    }
}

/// Powers of the complex number s + i·t.
struct Powers {
    /// Real and imaginary parts of the power m − 1 at index m; those of index 0 are zero.
    below: [Orders; 2],
    /// Real and imaginary parts of the power m at index m.
    at: [Orders; 2],
}

impl Powers {
    /// Powers up to [`DEGREE`]. Each is a product of two lower ones, so that they do not wait for each other in a chain.
    #[inline(always)]
    fn new(s: f64, t: f64) -> Self {
        let mut powers = [[1.0, 0.0]; DEGREE + 1];
        powers[1] = [s, t];
        for m in 2..=DEGREE {
            let ([a, b], [c, d]) = (powers[m / 2], powers[m - m / 2]);
            powers[m] = [a * c - b * d, a * d + b * c];
        }
        let (mut below, mut at) = ([[0.0; ROW]; 2], [[0.0; ROW]; 2]);
        for m in 0..=DEGREE {
            for part in 0..2 {
                at[part][m] = powers[m][part];
                below[part][m + 1] = powers[m][part];
            }
        }
        Self { below, at }
    }
}

/// Spherical harmonics of a field at a planet-fixed position, m. Their value is the acceleration, m/s².
struct Harmonics<'a> {
    field: &'a Field,
    position: Vector3<f64>,
}

impl WithSimd for Harmonics<'_> {
    type Output = Vector3<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vector3<f64> {
        match S::F64_LANES {
            8 => self.acceleration::<S, 1, 2>(simd),
            4 => self.acceleration::<S, 2, 4>(simd),
            2 => self.acceleration::<S, 4, 8>(simd),
            _ => self.acceleration::<S, 8, 16>(simd),
        }
    }
}

impl Harmonics<'_> {
    /// Acceleration in the planet-fixed frame, m/s², with `N` registers for a row and `H` for half a row.
    #[inline(always)]
    fn acceleration<S: Simd, const H: usize, const N: usize>(self, simd: S) -> Vector3<f64> {
        let radius = norm(&self.position);
        let inverse = 1.0 / radius;
        let [s, t, u] = self.position.map(|x| x * inverse);
        let powers = Powers::new(s, t);
        let ratio = EARTH_RADIUS_M * inverse;
        let mut factor = EARTH_MU * inverse * inverse;
        let point_mass = -factor;
        let degrees = &self.field.degrees;
        let mut first = [0.0; ROW];
        first[0] = 1.0;
        let mut low = HarmonicSums::<S, H>::new(simd, &first);
        low.advance(&degrees[0], u);
        // The orders of degrees below `HALF_ROW` fit half a row; those of the next degree are needed, too.
        let half = degrees.len().min(HALF_ROW - 1);
        for (degree, next) in degrees[..half].iter().zip(&degrees[1..half]) {
            factor *= ratio;
            low.add(degree, next, &powers, factor, u);
        }
        let mut sums = low.widened::<N>();
        for (degree, next) in degrees[half - 1..].iter().zip(&degrees[half..]) {
            factor *= ratio;
            sums.add(degree, next, &powers, factor, u);
        }
        let [a1, a2, a3, a4] = sums.sums.map(sum);
        let radial = point_mass - a4;
        [a1 + s * radial, a2 + t * radial, a3 + u * radial]
    }
}

/// Sums over the degrees so far by order, and derived Legendre functions of a degree and the one below: at the index of their order
/// and at that of the order before.
struct HarmonicSums<S: Simd, const N: usize> {
    simd: S,
    sums: [Pack<S, N>; 4],
    row: Pack<S, N>,
    row_below: Pack<S, N>,
    ahead: Pack<S, N>,
    ahead_below: Pack<S, N>,
}

impl<S: Simd, const N: usize> HarmonicSums<S, N> {
    /// Sums before the first degree, with the functions of degree 0.
    #[inline(always)]
    fn new(simd: S, first: &Orders) -> Self {
        let zero = Pack::splat(simd, 0.0);
        Self {
            simd,
            sums: [zero; 4],
            row: Pack::load(simd, first),
            row_below: zero,
            ahead: zero,
            ahead_below: zero,
        }
    }

    /// The same in more registers.
    #[inline(always)]
    fn widened<const M: usize>(&self) -> HarmonicSums<S, M> {
        let [a, b, c, d] = &self.sums;
        HarmonicSums {
            simd: self.simd,
            sums: [a.widened(), b.widened(), c.widened(), d.widened()],
            row: self.row.widened(),
            row_below: self.row_below.widened(),
            ahead: self.ahead.widened(),
            ahead_below: self.ahead_below.widened(),
        }
    }

    /// Advances the functions to the next degree.
    #[inline(always)]
    fn advance(&mut self, next: &Degree, u: f64) {
        let row = next.legendre.next(self.simd, &self.row, &self.row_below, u);
        let ahead = next.legendre_ahead.next(self.simd, &self.ahead, &self.ahead_below, u);
        (self.row_below, self.ahead_below) = (self.row, self.ahead);
        (self.row, self.ahead) = (row, ahead);
    }

    /// Adds the terms of a degree, and advances the functions to the next one.
    #[inline(always)]
    fn add(&mut self, degree: &Degree, next: &Degree, powers: &Powers, factor: f64, u: f64) {
        let simd = self.simd;
        let ([real, imaginary], [real_at, imaginary_at]) = (&powers.below, &powers.at);
        let (real, imaginary) = (load(simd, real), load(simd, imaginary));
        let d = (load(simd, &degree.cos) * load(simd, real_at)
            + load(simd, &degree.sin) * load(simd, imaginary_at))
        .times(factor);
        let weighted = self.row.times(factor);
        let (cos, sin) = (load(simd, &degree.order_cos), load(simd, &degree.order_sin));
        self.sums[0] = self.sums[0] + weighted * (cos * real + sin * imaginary);
        self.sums[1] = self.sums[1] + weighted * (sin * real - cos * imaginary);
        self.sums[2] = self.sums[2] + load(simd, &degree.q1) * self.ahead * d;
        self.advance(next, u);
        self.sums[3] = self.sums[3] + load(simd, &degree.q2) * self.ahead * d;
    }
}

/// Loads the orders of `N` registers from a row.
#[inline(always)]
fn load<S: Simd, const N: usize>(simd: S, row: &Orders) -> Pack<S, N> {
    Pack::load(simd, row)
}

/// Sum of a row by halves.
#[inline(always)]
fn sum<S: Simd, const N: usize>(orders: Pack<S, N>) -> f64 {
    let mut row = [0.0; ROW];
    orders.store(&mut row);
    for half in [8, 4, 2, 1] {
        for m in 0..half {
            row[m] += row[m + half];
        }
    }
    row[0]
}
