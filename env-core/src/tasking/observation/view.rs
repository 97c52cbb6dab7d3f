//! State of a satellite as observations see it.

use crate::tasking::earth::EARTH_RATE_RAD_S;
use crate::tasking::orbit::OrbitalElements;
use crate::tasking::satellite::SatelliteSpec;
use crate::tasking::tick::attitude::body_from_inertial;
use crate::tasking::tick::state::TickState;
use crate::tasking::vector3::{Matrix3, Vector3, cross, norm, rotate, rotate_back, scale};

/// State of a satellite after a tick, and the sky at that tick.
#[derive(Debug, Clone, Copy)]
pub struct SatelliteView<'a> {
    /// Name, models and arguments.
    pub spec: &'a SatelliteSpec,
    /// State after the tick.
    pub state: &'a TickState<f64>,
    /// Bits in all partitions of the storage.
    pub stored_bits: f64,
    /// Velocity in the inertial frame, m/s.
    pub velocity: Vector3<f64>,
    /// Rotation from the inertial to the planet-fixed frame.
    pub planet: Matrix3<f64>,
    /// Position of the Sun in the inertial frame, m.
    pub sun: Vector3<f64>,
    /// Time, s since the episode's start.
    pub time_s: f64,
    /// Orbital elements as observations have them.
    pub elements: OrbitalElements,
}

impl SatelliteView<'_> {
    /// Rotation from the inertial frame to the body.
    #[must_use]
    pub fn body(&self) -> Matrix3<f64> {
        body_from_inertial(&self.state.attitude.sigma)
    }

    /// Rotation from the inertial frame to the Hill frame: radial, along track, orbit normal.
    #[must_use]
    pub fn hill(&self) -> Matrix3<f64> {
        let radial = scale(&self.state.position, 1.0 / norm(&self.state.position));
        let momentum = cross(&self.state.position, &self.velocity);
        let normal = scale(&momentum, 1.0 / norm(&momentum));
        [radial, cross(&normal, &radial), normal]
    }

    /// Position in the planet-fixed frame, m.
    #[must_use]
    pub fn planet_position(&self) -> Vector3<f64> {
        rotate(&self.planet, &self.state.position)
    }

    /// Angular velocity of the planet in the inertial frame, rad/s.
    #[must_use]
    pub fn planet_rate(&self) -> Vector3<f64> {
        scale(&self.planet[2], EARTH_RATE_RAD_S)
    }

    /// Direction of the instrument in the inertial frame.
    #[must_use]
    pub fn instrument(&self) -> Vector3<f64> {
        rotate_back(&self.body(), &self.spec.args.instrument_axis)
    }

    /// Angular velocity of the body in the inertial frame, rad/s.
    #[must_use]
    pub fn body_rate(&self) -> Vector3<f64> {
        rotate_back(&self.body(), &self.state.attitude.omega)
    }
}
