//! Physical constants of Basilisk 2.12.1 and hardware of BSK-RL 1.3.8, in SI units.

/// Gravitational parameter of the Earth, m³/s² (JPL DE403).
pub const EARTH_MU: f64 = 398_600.436e9;
/// Equatorial radius of the Earth, m: that of gravity, stations, targets and eclipses.
pub const EARTH_RADIUS_M: f64 = 6_378_136.6;
/// Gravitational parameter of the Sun, m³/s² (JPL DE403).
pub const SUN_MU: f64 = 132_712_440_023.310e9;
/// Equatorial radius of the Sun, m.
pub const SUN_RADIUS_M: f64 = 695_000e3;
/// Astronomical unit, m, as in Basilisk.
pub const ASTRONOMICAL_UNIT_M: f64 = 149_597_870_693.0;
/// Solar flux at one astronomical unit, W/m².
pub const SOLAR_FLUX_W_M2: f64 = 1361.0;
/// Largest speed of a Honeywell HR16 wheel, rad/s: 6 000 rpm.
pub const MAX_WHEEL_SPEED_RAD_S: f64 = 6000.0 * RAD_S_PER_RPM;
/// Inertia of a wheel about its axis, kg·m²: 50 N·m·s at its largest speed.
pub const WHEEL_INERTIA_KG_M2: f64 = 50.0 / MAX_WHEEL_SPEED_RAD_S;
/// Angular speed of one revolution a minute, rad/s.
pub const RAD_S_PER_RPM: f64 = 2.0 * std::f64::consts::PI / 60.0;
/// Thrust of a MOOG Monarc-1 thruster, N.
pub const THRUST_N: f64 = 0.9;
/// Number of thrusters that desaturate the wheels.
pub const THRUSTERS: usize = 8;
