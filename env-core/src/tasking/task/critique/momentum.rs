//! Sources of the wheels' angular momentum.

use crate::tasking::constants::{RAD_S_PER_RPM, WHEEL_INERTIA_KG_M2};
use crate::tasking::satellite::TaskedSatellite;
use crate::tasking::vector3::Vector3;

/// Speeds of the wheels by their sources, rpm. Each wheel turns about an axis of the body. By the conservation of angular momentum, a
/// torque of the disturbance or of the thrusters about that axis changes its speed by the torque's impulse over the wheel's inertia;
/// the rest of a change is momentum that came from the other wheels and from the body, as the body turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WheelMomentum {
    /// Speeds at the start of the episode.
    pub at_start_rpm: Vector3<f64>,
    /// Speeds after the time.
    pub now_rpm: Vector3<f64>,
    /// Parts that the constant disturbing torque added.
    pub disturbance_rpm: Vector3<f64>,
    /// Parts that the thrusters added.
    pub thrusters_rpm: Vector3<f64>,
}

impl WheelMomentum {
    /// Splits the speeds of a satellite's wheels after a time, s. `impulse` is that of the thrusters, N·m·s.
    pub(super) fn of(satellite: &TaskedSatellite, impulse: &Vector3<f64>, time_s: f64) -> Self {
        let args = &satellite.spec().args;
        let rpm = |momentum: f64| momentum / WHEEL_INERTIA_KG_M2 / RAD_S_PER_RPM;
        Self {
            at_start_rpm: args.wheel_speeds_rpm,
            now_rpm: satellite.state.attitude.wheels.map(|speed| speed / RAD_S_PER_RPM),
            disturbance_rpm: args.disturbance_n_m.map(|torque| rpm(torque * time_s)),
            thrusters_rpm: impulse.map(rpm),
        }
    }

    /// Index of the fastest wheel.
    pub(super) fn fastest(&self) -> usize {
        let speed = |wheel: usize| self.now_rpm[wheel].abs();
        (1..self.now_rpm.len()).fold(0, |best, wheel| if speed(wheel) > speed(best) { wheel } else { best })
    }

    /// Part of a wheel's speed that came from the other wheels and the body, rpm.
    pub(super) fn turning_rpm(&self, wheel: usize) -> f64 {
        let others = self.at_start_rpm[wheel] + self.disturbance_rpm[wheel] + self.thrusters_rpm[wheel];
        self.now_rpm[wheel] - others
    }
}
