//! Bearings: the direction of a point seen from a satellite, as an angle.

use super::kernel::Body;
use crate::critique::angle_deg;

/// Reference axes of a bearing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BearingFrame {
    /// Angle from radial out towards in-track (prograde).
    RadialInTrack,
    /// Angle from +X towards +Y.
    Inertial,
}

impl BearingFrame {
    /// Bearing of a position (x and y in LU) seen from the satellite `of`, degrees in [0, 360).
    #[must_use]
    pub fn bearing_deg(self, of: &Body, position: [f64; 2]) -> f64 {
        let (dx, dy) = (position[0] - of.x, position[1] - of.y);
        match self {
            Self::Inertial => angle_deg(dx, dy),
            Self::RadialInTrack => {
                let ((rx, ry), (tx, ty)) = of.local_axes();
                angle_deg(dx * rx + dy * ry, dx * tx + dy * ty)
            }
        }
    }

    /// Direction of a bearing seen from the satellite `of`, as an angle from +X towards +Y, degrees.
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
    fn bearings_turn_from_radial_out_to_in_track() {
        let satellite = Body { x: 0.0, y: 50.0, vx: -4.0, vy: 0.0 };
        // Above the satellite, ahead of it (prograde is −x there), below it, behind it.
        let positions = [[0.0, 60.0], [-10.0, 50.0], [0.0, 40.0], [10.0, 50.0]];
        for (position, expected) in positions.into_iter().zip([0.0, 90.0, 180.0, 270.0]) {
            let bearing = BearingFrame::RadialInTrack.bearing_deg(&satellite, position);
            // Bound: one rounding of atan2 and one of the conversion to degrees.
            assert!((bearing - expected).abs() < 1e-9, "{bearing} {expected}");
            let direction = BearingFrame::RadialInTrack.direction_deg(&satellite, bearing);
            let inertial = BearingFrame::Inertial.bearing_deg(&satellite, position);
            assert!((direction - inertial).abs() % 360.0 < 1e-9, "{direction} {inertial}");
        }
    }
}
