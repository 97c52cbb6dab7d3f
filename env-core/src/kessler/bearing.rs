//! Where something is, seen from a satellite, as an angle.

use super::kernel::Body;
use crate::critique::angle_deg;

/// Axes that bearings are measured in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// From radial out towards in-track (prograde).
    RadialInTrack,
    /// From +X towards +Y.
    Inertial,
}

impl Frame {
    /// The bearing of a place seen from a satellite, degrees in [0, 360).
    #[must_use]
    pub fn bearing_deg(self, of: &Body, at: (f64, f64)) -> f64 {
        let (dx, dy) = (at.0 - of.x, at.1 - of.y);
        match self {
            Self::Inertial => angle_deg(dx, dy),
            Self::RadialInTrack => {
                let ((rx, ry), (tx, ty)) = of.frame();
                angle_deg(dx * rx + dy * ry, dx * tx + dy * ty)
            }
        }
    }

    /// The direction of a bearing seen from a satellite, as an angle from +X towards +Y, degrees.
    #[must_use]
    pub fn direction_deg(self, of: &Body, bearing_deg: f64) -> f64 {
        match self {
            Self::Inertial => bearing_deg,
            Self::RadialInTrack => bearing_deg + angle_deg(of.x, of.y),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bearings_run_from_radial_out_to_in_track() {
        let of = Body { x: 0.0, y: 50.0, vx: -4.0, vy: 0.0 };
        // Above it, ahead of it (prograde is −x up there), below it, behind it.
        let around = [(0.0, 60.0), (-10.0, 50.0), (0.0, 40.0), (10.0, 50.0)];
        for (at, wanted) in around.into_iter().zip([0.0, 90.0, 180.0, 270.0]) {
            let found = Frame::RadialInTrack.bearing_deg(&of, at);
            // One rounding of atan2 and one of the scale.
            assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
            let direction = Frame::RadialInTrack.direction_deg(&of, found);
            let seen = Frame::Inertial.bearing_deg(&of, at);
            assert!((direction - seen).abs() % 360.0 < 1e-9, "{direction} {seen}");
        }
    }
}
