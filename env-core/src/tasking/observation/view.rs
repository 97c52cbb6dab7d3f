//! State of a satellite as observations see it.

use crate::tasking::earth::EARTH_RATE_RAD_S;
use crate::tasking::orbit::{OrbitalElements, hill_frame};
use crate::tasking::satellite::SatelliteSpec;
use crate::tasking::tick::state::TickState;
use crate::tasking::vector3::{Matrix3, Vector3, rotate_back, scale};

/// State of a satellite after a tick, and the sky at that tick.
#[derive(Debug, Clone, Copy)]
pub struct SatelliteView<'a> {
    /// Name, models and arguments.
    pub spec: &'a SatelliteSpec,
    /// State after the tick.
    pub state: &'a TickState<f64>,
    /// Bits in all partitions of the storage.
    pub stored_bits: f64,
    /// Further values of the moment.
    pub moment: &'a Moment,
}

/// Orbit, attitude and sky of a satellite at one moment.
#[derive(Debug, Clone, Copy)]
pub struct Moment {
    /// Time, s since the episode's start.
    pub time_s: f64,
    /// Velocity in the inertial frame, m/s.
    pub velocity: Vector3<f64>,
    /// Orbital elements as observations have them.
    pub elements: OrbitalElements,
    /// Rotation from the inertial to the planet-fixed frame.
    pub planet: Matrix3<f64>,
    /// Position of the Sun in the inertial frame, m.
    pub sun: Vector3<f64>,
    /// Rotation from the inertial frame to the body.
    pub body: Matrix3<f64>,
    /// Position in the planet-fixed frame, m.
    pub planet_position: Vector3<f64>,
    /// Direction of the instrument in the inertial frame.
    pub instrument: Vector3<f64>,
    /// Direction of the instrument in the planet-fixed frame.
    pub instrument_fixed: Vector3<f64>,
}

impl SatelliteView<'_> {
    /// Rotation from the inertial frame to the Hill frame: radial, along track, orbit normal.
    #[must_use]
    pub fn hill(&self) -> Matrix3<f64> {
        hill_frame(&self.state.position, &self.moment.velocity)
    }

    /// Angular velocity of the planet in the inertial frame, rad/s.
    #[must_use]
    pub fn planet_rate(&self) -> Vector3<f64> {
        scale(&self.moment.planet[2], EARTH_RATE_RAD_S)
    }

    /// Angular velocity of the body in the inertial frame, rad/s.
    #[must_use]
    pub fn body_rate(&self) -> Vector3<f64> {
        rotate_back(&self.moment.body, &self.state.attitude.omega)
    }
}
