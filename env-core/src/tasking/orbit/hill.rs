//! The Hill frame of an orbit.

use crate::tasking::vector3::{Matrix3, Vector3, cross, norm, scale};

/// Axes of the Hill frame of a position and a velocity: radial, along track, orbit normal.
#[must_use]
pub fn hill_frame(position: &Vector3<f64>, velocity: &Vector3<f64>) -> Matrix3<f64> {
    let radial = scale(position, 1.0 / norm(position));
    let momentum = cross(position, velocity);
    let normal = scale(&momentum, 1.0 / norm(&momentum));
    [radial, cross(&normal, &radial), normal]
}
