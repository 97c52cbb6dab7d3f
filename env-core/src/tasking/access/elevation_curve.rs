//! Elevation of the searched trajectory over a location, as BSK-RL computes it.

use std::f64::consts::FRAC_PI_2;

use super::locations::Locations;
use super::spline::UniformSpline;
use crate::tasking::vector3::{Vector3, dot, norm, sub};

/// Elevation over a location at every time, also outside of the trajectory.
pub(super) struct ElevationCurve<'a> {
    spline: &'a UniformSpline,
    location: &'a Vector3<f64>,
    radius_m: f64,
    min_elevation_rad: f64,
}

impl<'a> ElevationCurve<'a> {
    /// Creates the curve of a location.
    pub(super) fn new(spline: &'a UniformSpline, locations: &'a Locations, location: usize) -> Self {
        Self {
            spline,
            location: locations.position(location),
            radius_m: locations.radii_m()[location],
            min_elevation_rad: locations.elevation_rad(location),
        }
    }

    /// Angle by which the elevation is below its minimum at a time, rad.
    pub(super) fn shortfall(&self, seconds: f64) -> f64 {
        let away = sub(&self.spline.position(seconds), self.location);
        let cosine = dot(self.location, &away) / (self.radius_m * norm(&away));
        -((FRAC_PI_2 - libm::acos(cosine)) - self.min_elevation_rad)
    }
}
