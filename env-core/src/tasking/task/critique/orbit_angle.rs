//! The orbit angle: where on its orbit a satellite is, relative to the Sun.

use crate::critique::{SectorQuantity, angle_deg};
use crate::tasking::vector3::{Vector3, cross, dot, scale, sub};

/// The angle by whose sectors the failure profiles of the world are divided.
pub(in crate::tasking::task) const ORBIT_ANGLE: SectorQuantity = SectorQuantity {
    name: "orbit angle",
    description: "angle of the satellite along its orbit from local noon, the point nearest to the Sun, in the direction of motion",
    directions: ["noon", "towards night", "midnight", "towards day"],
};

/// Orbit angle of a satellite, degrees in [0, 360): from the direction of the Sun in the plane of the orbit, in the direction of
/// motion. `position` and `velocity` are inertial, `sun` is the Sun's position relative to the Earth. Only directions matter.
pub(in crate::tasking::task) fn orbit_angle_deg(
    position: &Vector3<f64>,
    velocity: &Vector3<f64>,
    sun: &Vector3<f64>,
) -> f64 {
    let normal = cross(position, velocity);
    let square = dot(&normal, &normal);
    if square <= 0.0 {
        return 0.0;
    }
    let noon = sub(sun, &scale(&normal, dot(sun, &normal) / square));
    let ahead = cross(&normal, &noon);
    let length = square.sqrt();
    // An angle that rounds to 360° in single precision is 0°.
    let angle = angle_deg(dot(position, &noon), dot(position, &ahead) / length);
    if angle as f32 >= 360.0 { 0.0 } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_go_from_noon_in_the_direction_of_motion() {
        // The Sun is above the plane of the orbit, over its +x axis.
        let sun = [1.3e11, 0.0, 0.5e11];
        let at = |degrees: f64, sense: f64| {
            let (sin, cos) = libm::sincos(degrees.to_radians());
            orbit_angle_deg(&[7e6 * cos, 7e6 * sin, 0.0], &[-7e3 * sense * sin, 7e3 * sense * cos, 0.0], &sun)
        };
        for degrees in [0.0, 30.0, 90.0, 180.0, 270.0, 359.0] {
            // Roundings of a few products and of atan2.
            assert!((at(degrees, 1.0) - degrees).abs() < 1e-9, "{degrees}");
            assert!((at(degrees, -1.0) - (360.0 - degrees) % 360.0).abs() < 1e-9, "{degrees} backwards");
        }
    }

    #[test]
    fn a_degenerate_orbit_has_a_finite_angle() {
        let zero = [0.0; 3];
        assert_eq!(orbit_angle_deg(&[7e6, 0.0, 0.0], &zero, &[1.5e11, 0.0, 0.0]).to_bits(), 0);
        // The Sun is perpendicular to the plane of the orbit.
        let angle = orbit_angle_deg(&[7e6, 0.0, 0.0], &[0.0, 7e3, 0.0], &[0.0, 0.0, 1.5e11]);
        assert!((0.0..360.0).contains(&angle), "{angle}");
    }
}
