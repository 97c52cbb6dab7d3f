//! Flight software of a satellite: the tasks that an action enables.

use crate::tasking::setup::{DynamicsModel, SoftwareModel};
use crate::tasking::vector3::Vector3;

/// A command to the flight software: the functions of BSK-RL's flight software models that actions call.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Points the panel at the Sun (`action_charge`).
    Charge,
    /// Aligns with the Hill frame and sends data to ground stations (`action_downlink`).
    Downlink,
    /// Desaturates the wheels (`action_desat`).
    Desaturate,
    /// Aligns with the Hill frame (`action_nadir_point`).
    NadirPoint,
    /// Stops controlling the wheels (`action_drift`).
    Drift,
    /// Scans the ground below (`action_nadir_scan`).
    Scan,
    /// Points at a planet-fixed position, m, and images it once (`action_image`).
    Image(Vector3<f64>),
}

/// Target of the boresight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PointingTarget {
    /// The panel points at the Sun.
    Sun,
    /// The instrument points at a planet-fixed position, m.
    Location(Vector3<f64>),
}

/// Tasks that run, and devices that are on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Software {
    /// Target of the boresight, if one is tracked.
    pub pointing: Option<PointingTarget>,
    /// True if the body is aligned with the Hill frame.
    pub is_hill: bool,
    /// True if the wheels are controlled.
    pub is_controlled: bool,
    /// True if the instrument controller runs.
    pub is_triggering: bool,
    /// True if the instrument obeys the controller's last command.
    pub is_listening: bool,
    /// True if the instrument draws power.
    pub instrument_on: bool,
    /// True if the transmitter sends and draws power.
    pub transmitter_on: bool,
    /// True if the thrusters draw power.
    pub thrusters_on: bool,
}

impl Software {
    /// State before the first command: nothing is controlled, but all sinks draw power and the transmitter sends, which are
    /// Basilisk's defaults.
    #[must_use]
    pub fn at_start(dynamics: DynamicsModel, software: SoftwareModel) -> Self {
        Self {
            is_listening: !software.continuous,
            instrument_on: dynamics.instrument,
            transmitter_on: dynamics.instrument,
            thrusters_on: true,
            ..Self::default()
        }
    }
}

/// Planet-fixed position at which a scan points, m: BSK-RL's location near the Earth's centre.
pub const SCAN_LOCATION: Vector3<f64> = [0.0, 0.0, 0.1];
