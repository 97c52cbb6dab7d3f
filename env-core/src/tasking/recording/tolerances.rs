//! Compared quantities, and the largest allowed difference of each.

use crate::tasking::constants::RAD_S_PER_RPM;
use crate::tasking::satellite::SatelliteSpec;

/// Compared quantities in the order of presentation.
pub const QUANTITIES: [&str; 28] = [
    "step_end",
    "reward",
    "storage",
    "battery",
    "attitude",
    "rate",
    "wheel_speed",
    "position",
    "velocity",
    "net_power",
    "panel_power",
    "illumination",
    "sampled_illumination",
    "pointing_error",
    "guidance",
    "motor_torque",
    "thruster_time",
    "elevation",
    "range",
    "sun",
    "earth_rotation",
    "observation",
    "observed_priority",
    "observed_window",
    "observed_eclipse",
    "eclipse",
    "target_window",
    "station_window",
];

/// Times of ticks, steps and eclipses, s: they are equal but for rounding.
pub const TIME_S: f64 = 1e-6;
/// Values that are equal but for rounding.
pub const ROUNDING: f64 = 1e-12;
/// Rewards for data: they are equal but for rounding.
pub const REWARD: f64 = 1e-9;
/// Rewards that include changes of a resource.
pub const RESOURCE_REWARD: f64 = 1e-5;
/// Battery at the ends of steps, W·s.
pub const BATTERY_WS: f64 = 1.0;
/// MRP of the attitude of satellites that image targets, at the ends of steps.
pub const IMAGER_SIGMA: f64 = 1e-6;
/// MRP of the attitude of other satellites. Wheels that drift with their last torque, and long ticks, amplify rounding.
pub const SIGMA: f64 = 1e-5;
/// Angular velocity at the ends of steps, rad/s.
pub const OMEGA_RAD_S: f64 = 1e-6;
/// Wheel speeds at the ends of steps, rad/s.
pub const WHEELS_RAD_S: f64 = 0.02;
/// Net power of the last tick of a step, W.
pub const NET_POWER_W: f64 = 0.02;
/// Share of sunlight. In the penumbra, 76 km long, it changes with the position.
pub const ILLUMINATION: f64 = 2e-4;
/// Share of sunlight of the searched trajectory, whose orbit Basilisk propagates with steps of 30 s: it errs by 60 m a revolution.
pub const SAMPLED_ILLUMINATION: f64 = 0.01;
/// Direction of the Sun from the Earth, arcseconds.
pub const SUN_ARCSEC: f64 = 0.02;
/// Elements of the Earth's rotation matrix.
pub const EARTH_ROTATION: f64 = 1e-11;
/// Windows of ground stations in lists and observations, s.
pub const STATION_WINDOW_S: f64 = 0.1;
/// Windows of targets in lists, s.
pub const TARGET_WINDOW_S: f64 = 0.03;
/// Windows of targets in observations, s.
pub const OBSERVED_TARGET_WINDOW_S: f64 = 0.05;

/// Position, m. Basilisk propagates orbits with the length of a tick; the error of its RK4 grows with the fourth power.
#[must_use]
pub fn position_m(tick_s: f64) -> f64 {
    let square = tick_s * tick_s;
    0.5 * (square * square / 100.0).max(1.0)
}

/// Velocity, m/s: the position's difference times twice the rate of an orbit of 300 km.
#[must_use]
pub fn velocity_m_s(tick_s: f64) -> f64 {
    0.0024 * position_m(tick_s)
}

/// Attitude of a satellite at the ends of steps, MRP.
#[must_use]
pub const fn sigma(satellite: &SatelliteSpec) -> f64 {
    let is_imager = satellite.dynamics.instrument && !satellite.dynamics.continuous;
    if is_imager { IMAGER_SIGMA } else { SIGMA }
}

/// Direction of an axis of a satellite, rad: a change of the MRP turns the body by four times as much at most.
#[must_use]
pub const fn direction_rad(satellite: &SatelliteSpec) -> f64 {
    4.0 * sigma(satellite)
}

/// Share of the battery's capacity.
#[must_use]
pub const fn battery_fraction(satellite: &SatelliteSpec) -> f64 {
    BATTERY_WS / satellite.args.battery_capacity_ws + ROUNDING
}

/// Speed of a wheel as a share of its limit.
#[must_use]
pub const fn wheel_fraction(satellite: &SatelliteSpec) -> f64 {
    WHEELS_RAD_S / (satellite.args.max_wheel_speed_rpm * RAD_S_PER_RPM) + ROUNDING
}

/// Largest differences of each tick of a trace.
pub mod trace {
    /// MRP of the attitude.
    pub const SIGMA: f64 = 1e-7;
    /// Angular velocity of the body, rad/s.
    pub const OMEGA_RAD_S: f64 = 1e-8;
    /// Speeds of the wheels, rad/s.
    pub const WHEELS_RAD_S: f64 = 1e-4;
    /// Net power of the battery, and power of the panel, W.
    pub const POWER_W: f64 = 1e-3;
    /// Charge of the battery, W·s.
    pub const BATTERY_WS: f64 = 0.1;
    /// Commanded motor torque, N·m.
    pub const MOTOR_TORQUE_N_M: f64 = 1e-5;
    /// Position of the satellite and its distance from a target, m.
    pub const POSITION_M: f64 = 0.5;
    /// Velocity of the satellite, m/s.
    pub const VELOCITY_M_S: f64 = 0.0012;
    /// MRP of the body relative to the reference of the guidance. A reference moves with the position, by 1e-6 rad at 500 km.
    pub const GUIDANCE: f64 = 1e-6;
    /// Elevation of the satellite above a target's horizon, rad.
    pub const ELEVATION_RAD: f64 = 2e-6;
    /// Times for which thrusters fire, and times of pulses, s.
    pub const THRUSTERS_S: f64 = 1e-6;
}
