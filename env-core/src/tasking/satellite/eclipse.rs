//! Share of the Sun that a satellite sees past the Earth: Basilisk's `eclipse`, conical with a spherical Earth (Montenbruck and
//! Gill 2000, *Satellite Orbits*, eqs. 3.85–3.94).

use std::f64::consts::PI;

use crate::tasking::constants::{EARTH_RADIUS_M, SUN_RADIUS_M};
use crate::tasking::vector3::{Vector3, dot, norm, sub};

/// Sine and cosine of 0.08 rad: by a smaller angle a satellite and the Sun move relative to each other in the time of an arc.
const ARC_MARGIN: [f64; 2] = [0.079_914_693_969_172_7, 0.996_801_706_302_619_4];
/// Slope of a cone that is wider than umbra and penumbra: more than (R☉ + R)/d with the Sun at 0.98 AU.
const SHADOW_SLOPE: f64 = 0.005;

/// Apparent sizes and distance of the Sun and the Earth.
struct EclipseGeometry {
    /// Sine and cosine of the Sun's apparent radius.
    sun: [f64; 2],
    /// Sine and cosine of the Earth's apparent radius.
    earth: [f64; 2],
    /// Cosine of the angle between the centres.
    cosine: f64,
    /// True if the satellite is nearer to the Sun than the Earth is.
    is_before_earth: bool,
}

impl EclipseGeometry {
    fn new(position: &Vector3<f64>, sun: &Vector3<f64>) -> Self {
        let to_sun = sub(sun, position);
        let (sun_distance, radius) = (norm(&to_sun), norm(position));
        let with_cosine = |sine: f64| {
            let sine = sine.min(1.0);
            [sine, (1.0 - sine * sine).sqrt()]
        };
        Self {
            sun: with_cosine(SUN_RADIUS_M / sun_distance),
            earth: with_cosine(EARTH_RADIUS_M / radius),
            cosine: (-dot(position, &to_sun) / (radius * sun_distance)).clamp(-1.0, 1.0),
            is_before_earth: sun_distance < norm(sun),
        }
    }

    /// Cosine of the sum of the apparent radii; beyond it the Sun is entirely visible.
    fn contact_cosine(&self) -> f64 {
        self.sun[1] * self.earth[1] - self.sun[0] * self.earth[0]
    }

    /// Cosine of the difference of the apparent radii; within it the Sun is entirely hidden.
    fn total_cosine(&self) -> f64 {
        self.sun[1] * self.earth[1] + self.sun[0] * self.earth[0]
    }
}

/// Share of the Sun's disc that is visible, 0 to 1. `position` is the satellite's, `sun` the Sun's, both relative to the Earth, m.
#[must_use]
pub fn illumination(position: &Vector3<f64>, sun: &Vector3<f64>) -> f64 {
    if let Some(certain) = certain_illumination(position, sun) {
        return certain;
    }
    let geometry = EclipseGeometry::new(position, sun);
    if geometry.is_before_earth || geometry.cosine <= geometry.contact_cosine() {
        return 1.0;
    }
    if geometry.earth[0] > geometry.sun[0] && geometry.cosine > geometry.total_cosine() {
        return 0.0;
    }
    let (a, b, c) = (libm::asin(geometry.sun[0]), libm::asin(geometry.earth[0]), libm::acos(geometry.cosine));
    if c < b - a {
        0.0
    } else if c < a - b {
        1.0 - (a * a - b * b) / (a * a)
    } else if c < a + b {
        let x = (c * c + a * a - b * b) / (2.0 * c);
        let y = (a * a - x * x).max(0.0).sqrt();
        let arc = |x: f64| libm::acos(x.clamp(-1.0, 1.0));
        let area = a * a * arc(x / a) + b * b * arc((c - x) / b) - c * y;
        1.0 - area / (PI * a * a)
    } else {
        1.0
    }
}

/// The share of the Sun's disc that is visible, if the distance from the axis of the shadow tells that it is 0 or 1.
fn certain_illumination(position: &Vector3<f64>, sun: &Vector3<f64>) -> Option<f64> {
    let square = dot(position, position);
    if square < EARTH_RADIUS_M * EARTH_RADIUS_M * 1.002 {
        return None; // The Earth fills half of the sky.
    }
    let along = dot(position, sun);
    let from_axis_2 = square - along * along / dot(sun, sun);
    let widening = SHADOW_SLOPE * square.sqrt();
    let (inner, outer) = (EARTH_RADIUS_M - widening, EARTH_RADIUS_M + widening);
    if along > 0.0 || from_axis_2 > outer * outer {
        Some(1.0)
    } else {
        (inner > 0.0 && from_axis_2 < inner * inner).then_some(0.0)
    }
}

/// The share of the Sun that is visible during the whole time of an arc (60 s) from this state on, if it is certain to be 0 or 1.
#[must_use]
pub fn constant_illumination(position: &Vector3<f64>, sun: &Vector3<f64>) -> Option<f64> {
    let geometry = EclipseGeometry::new(position, sun);
    let [sin_margin, cos_margin] = ARC_MARGIN;
    let contact = geometry.contact_cosine();
    let contact_sine = geometry.sun[0] * geometry.earth[1] + geometry.sun[1] * geometry.earth[0];
    if geometry.cosine < contact * cos_margin - contact_sine * sin_margin {
        return Some(1.0);
    }
    let total = geometry.total_cosine();
    let total_sine = geometry.earth[0] * geometry.sun[1] - geometry.earth[1] * geometry.sun[0];
    let is_wide_enough = total_sine > sin_margin;
    (is_wide_enough && geometry.cosine > total * cos_margin + total_sine * sin_margin).then_some(0.0)
}
