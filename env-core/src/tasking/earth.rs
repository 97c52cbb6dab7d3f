//! Rotation of the Earth: IAU_EARTH of the IAU Working Group on Cartographic Coordinates (Archinal et al. 2011, *Celest. Mech.
//! Dyn. Astron.* 109, table 1), as SPICE's text kernel pck00010 has it.

use super::vector3::{Matrix3, Vector3};

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;
/// Seconds of a Julian century.
const CENTURY_S: f64 = DAY_S * 36_525.0;
/// Rotation of the prime meridian at J2000, degrees.
const MERIDIAN_DEG: f64 = 190.147;
/// Motion of the pole's right ascension, degrees a century.
const NODE_DEG_CENTURY: f64 = 0.641;
/// Motion of the pole's declination, degrees a century.
const TILT_DEG_CENTURY: f64 = 0.557;
/// Rotation rate of the Earth, degrees a day.
const RATE_DEG_DAY: f64 = 360.985_623_5;
/// Rotation rate of the Earth, rad/s.
pub const EARTH_RATE_RAD_S: f64 = RATE_DEG_DAY / DAY_S * (std::f64::consts::PI / 180.0);

/// The Earth's orientation around a moment: the slow motion of the pole is held, the rotation is not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EarthFrame {
    /// Rotation from the inertial frame (J2000) to the equator of date, by rows.
    pub equator: Matrix3<f64>,
    /// Cosine of the rotation angle of the prime meridian.
    pub cos: f64,
    /// Sine of the rotation angle of the prime meridian.
    pub sin: f64,
}

impl EarthFrame {
    /// Orientation at a barycentric dynamical time in seconds since J2000.
    #[must_use]
    pub fn at(tdb_s: f64) -> Self {
        EarthRotation::new(tdb_s).frame(0.0)
    }

    /// Rotation from the inertial to the planet-fixed frame.
    #[must_use]
    pub fn planet_from_inertial(&self) -> Matrix3<f64> {
        let [x, y, z] = self.equator;
        let turn = |a: f64, b: f64| (self.cos * a + self.sin * b, self.cos * b - self.sin * a);
        let mut rows = [x, y, z];
        for i in 0..3 {
            (rows[0][i], rows[1][i]) = turn(x[i], y[i]);
        }
        rows
    }

    /// Inertial vectors a, b, c of a planet-fixed vector, which is cos·a + sin·b + c as the Earth turns.
    #[must_use]
    pub fn turning_parts(&self, planet_fixed: &Vector3<f64>) -> [Vector3<f64>; 3] {
        let [x, y, z] = *planet_fixed;
        let e = &self.equator;
        [
            [0, 1, 2].map(|i| x * e[0][i] + y * e[1][i]),
            [0, 1, 2].map(|i| x * e[1][i] - y * e[0][i]),
            [0, 1, 2].map(|i| z * e[2][i]),
        ]
    }
}

/// The Earth's rotation in an episode.
///
/// The pole moves by 5e-8 of a revolution in a day, so that its angles are expanded to second order around the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EarthRotation {
    start_tdb_s: f64,
    /// Sine and cosine of the node of the equator at the start.
    node: [f64; 2],
    /// Sine and cosine of the tilt of the equator at the start.
    tilt: [f64; 2],
}

impl EarthRotation {
    /// Creates the rotation of an episode that starts at a barycentric dynamical time, s since J2000.
    #[must_use]
    pub fn new(start_tdb_s: f64) -> Self {
        let centuries = start_tdb_s / CENTURY_S;
        let pair = |angle: f64| {
            let (sin, cos) = libm::sincos(angle);
            [sin, cos]
        };
        Self {
            start_tdb_s,
            node: pair((90.0 - NODE_DEG_CENTURY * centuries).to_radians()),
            tilt: pair((TILT_DEG_CENTURY * centuries).to_radians()),
        }
    }

    /// Cosine and sine of the rotation of the prime meridian, after a time since the start, s.
    #[must_use]
    pub fn meridian(&self, seconds: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(meridian_rad(self.start_tdb_s + seconds));
        [cos, sin]
    }

    /// Orientation after a time since the start, s.
    #[must_use]
    pub fn frame(&self, seconds: f64) -> EarthFrame {
        self.frame_at(seconds, self.meridian(seconds))
    }

    /// Orientation after a time since the start, s, at which the meridian is known.
    #[must_use]
    pub fn frame_at(&self, seconds: f64, [cos, sin]: [f64; 2]) -> EarthFrame {
        const RAD_S: f64 = std::f64::consts::PI / 180.0 / CENTURY_S;
        let [sin_node, cos_node] = turned(self.node, -NODE_DEG_CENTURY * RAD_S * seconds);
        let [sin_tilt, cos_tilt] = turned(self.tilt, TILT_DEG_CENTURY * RAD_S * seconds);
        let equator = [
            [cos_node, sin_node, 0.0],
            [-cos_tilt * sin_node, cos_tilt * cos_node, sin_tilt],
            [sin_tilt * sin_node, -sin_tilt * cos_node, cos_tilt],
        ];
        EarthFrame { equator, cos, sin }
    }
}

/// Sine and cosine of an angle that changed by a small one, rad.
fn turned([sin, cos]: [f64; 2], change: f64) -> [f64; 2] {
    let shrink = 1.0 - 0.5 * change * change;
    [sin * shrink + cos * change, cos * shrink - sin * change]
}

/// Rotation angle of the prime meridian, radians, below one revolution.
fn meridian_rad(tdb_s: f64) -> f64 {
    let degrees = MERIDIAN_DEG + RATE_DEG_DAY * (tdb_s / DAY_S);
    libm::fmod(degrees, 360.0).to_radians()
}
