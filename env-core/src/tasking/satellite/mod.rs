//! One satellite of an episode: its state, its orbit, and the inputs of its lane.
//!
//! The lanes of a block run ticks until the first of them has an event; [`refresh`] then sets a lane's inputs for the next ones.

pub mod desaturation;
pub mod eclipse;
pub mod refresh;
pub mod software;
pub mod transmitter;

use self::desaturation::{Desaturation, DesaturationSettings, Pulse};
use self::software::{Command, PointingTarget, SCAN_LOCATION, Software};
use self::transmitter::{Transmitter, TransmitterSettings};
use super::access::{GroundTrack, LocationSet};
use super::clock::TickLength;
use super::constants::RAD_S_PER_RPM;
use super::orbit::{GravityModel, Orbit, Sky};
use super::setup::{DesatAttitude, DynamicsModel, SatelliteArgs, SoftwareModel};
use super::tick::attitude::{Attitude, short_rotation};
use super::tick::state::TickState;
use super::vector3::{Vector3, norm, scale};

/// Name, models and realised arguments of a satellite.
#[derive(Debug, Clone, PartialEq)]
pub struct SatelliteSpec {
    /// Name of the satellite.
    pub name: String,
    /// Features of the dynamics model.
    pub dynamics: DynamicsModel,
    /// Features of the flight software model.
    pub software: SoftwareModel,
    /// Realised arguments of the models.
    pub args: SatelliteArgs,
}

impl SatelliteSpec {
    /// True if the instrument records in every tick: no flight software commands it, and Basilisk's instruments are on then.
    #[must_use]
    pub const fn records_always(&self) -> bool {
        self.dynamics.instrument && !self.software.imaging
    }
}

/// Settings that the satellites of an episode share.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Environment {
    /// Gravity model of the orbits.
    pub gravity: GravityModel,
    /// True if thrusters deliver their whole impulse, false for Basilisk's rule.
    pub full_thrust: bool,
    /// Length of a tick.
    pub tick: TickLength,
}

/// A satellite in an episode.
#[derive(Debug, Clone)]
pub struct TaskedSatellite {
    spec: SatelliteSpec,
    environment: Environment,
    /// State after the last tick, while the satellite is not in a block.
    pub(crate) state: TickState<f64>,
    orbit: Orbit,
    track: GroundTrack,
    stations: LocationSet,
    software: Software,
    desaturation: Desaturation,
    transmitter: Transmitter,
    /// Initial data of an imager, which the instrument does not add to, bits.
    initial_stored: f64,
    /// The last tick before the last command in which the wheels were controlled.
    last_control: Option<u64>,
    /// The tick after which the last command was given.
    commanded_at: Option<u64>,
    /// Bits of the storage beyond which an awaited image is stored.
    pub(crate) awaited_bits: Option<f64>,
    cache: refresh::RefreshCache,
}

impl TaskedSatellite {
    /// Creates a satellite at the start of an episode. `stations` are its ground stations.
    #[must_use]
    pub fn new(spec: SatelliteSpec, environment: Environment, stations: LocationSet, sky: &Sky) -> Self {
        let args = &spec.args;
        let (position, velocity) = args.orbit.state(args.mu);
        let storage = if args.storage_init_bits > args.storage_capacity_bits {
            0.0
        } else {
            args.storage_init_bits.trunc().max(0.0)
        };
        let (stored, initial_stored) = if spec.dynamics.continuous { (storage, 0.0) } else { (0.0, storage) };
        let state = TickState {
            attitude: Attitude {
                sigma: short_rotation(&args.sigma_init),
                omega: args.omega_init_rad_s,
                wheels: scale(&args.wheel_speeds_rpm, RAD_S_PER_RPM),
            },
            motor: [0.0; 3],
            command: [0.0; 3],
            previous_sigma: [0.0; 3],
            is_first: 1.0,
            integral: [0.0; 3],
            position,
            arc_time: 0.0,
            earth_cos: 1.0,
            earth_sin: 0.0,
            battery: args.stored_charge_ws.min(args.battery_capacity_ws),
            net_power: 0.0,
            stored,
            is_commanded: f64::from(u8::from(spec.records_always())),
            is_imaged: 0.0,
        };
        let orbit = Orbit::new(environment.gravity, position, velocity, sky, environment.tick.seconds());
        Self {
            environment,
            state,
            orbit,
            track: GroundTrack::default(),
            stations,
            software: Software::at_start(spec.dynamics, spec.software),
            desaturation: Desaturation::default(),
            transmitter: Transmitter::default(),
            initial_stored,
            last_control: None,
            commanded_at: None,
            awaited_bits: None,
            cache: refresh::RefreshCache::default(),
            spec,
        }
    }

    /// Takes over the state of a copy of the same satellite, without its orbit and its stations, which both have.
    pub(crate) const fn copy_state_from(&mut self, other: &Self) {
        self.state = other.state;
        self.software = other.software;
        self.desaturation = other.desaturation;
        self.transmitter = other.transmitter;
        self.initial_stored = other.initial_stored;
        self.last_control = other.last_control;
        self.commanded_at = other.commanded_at;
        self.awaited_bits = other.awaited_bits;
        self.cache = other.cache;
    }

    /// Name of the satellite.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.spec.name
    }

    /// Name, models and arguments.
    #[must_use]
    pub const fn spec(&self) -> &SatelliteSpec {
        &self.spec
    }

    /// Gives a command to the flight software after the tick `now`. It resets all tasks first, as BSK-RL's `@action` does.
    pub fn command(&mut self, command: Command, now: u64) {
        if self.software.is_controlled && self.commanded_at != Some(now) {
            self.last_control = Some(now);
        }
        self.commanded_at = Some(now);
        self.desaturation.stop();
        self.software = Software {
            is_controlled: true,
            is_listening: !self.spec.software.continuous,
            ..Software::default()
        };
        self.state.is_first = 1.0;
        self.state.previous_sigma = [0.0; 3];
        let software = &mut self.software;
        match command {
            Command::Charge => software.pointing = Some(PointingTarget::Sun),
            Command::Downlink => (software.is_hill, software.transmitter_on) = (true, true),
            Command::NadirPoint => software.is_hill = true,
            Command::Drift => software.is_controlled = false,
            Command::Desaturate => {
                software.thrusters_on = true;
                match self.spec.args.desat_attitude {
                    DesatAttitude::Sun => software.pointing = Some(PointingTarget::Sun),
                    DesatAttitude::Nadir => software.is_hill = true,
                    DesatAttitude::None => {}
                }
                self.desaturation.start(now);
            }
            Command::Scan => {
                software.pointing = Some(PointingTarget::Location(SCAN_LOCATION));
                (software.is_triggering, software.is_listening, software.instrument_on) = (true, true, true);
            }
            Command::Image(position) => {
                software.pointing = Some(PointingTarget::Location(position));
                (software.is_triggering, software.instrument_on) = (true, true);
                self.state.is_imaged = 0.0;
            }
        }
    }

    /// The tick after which the flight software received its last command.
    #[must_use]
    pub const fn commanded_at(&self) -> Option<u64> {
        self.commanded_at
    }

    /// Tasks of the flight software that run, and devices that are on.
    #[must_use]
    pub const fn software(&self) -> &Software {
        &self.software
    }

    /// The pulse of the thrusters that acts in the next tick or later, if one was commanded.
    #[must_use]
    pub const fn pending_pulse(&self) -> Option<Pulse> {
        self.desaturation.pending()
    }

    /// True if the flight software aligns the body with the Hill frame.
    #[must_use]
    pub const fn is_aligned_with_hill(&self) -> bool {
        self.software.is_hill
    }

    /// Bits in the partition that the instrument fills, and of the initial data of an imager.
    #[must_use]
    pub const fn stored(&self) -> [f64; 2] {
        [self.state.stored, self.initial_stored]
    }

    /// Charge of the battery, J.
    #[must_use]
    pub const fn battery_ws(&self) -> f64 {
        self.state.battery
    }

    /// Net power of the last tick, W.
    #[must_use]
    pub const fn net_power_w(&self) -> f64 {
        self.state.net_power
    }

    /// True if attitude, wheels and battery are finite numbers.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let attitude = &self.state.attitude;
        let vectors = [attitude.sigma, attitude.omega, attitude.wheels];
        vectors.iter().flatten().all(|x| x.is_finite()) && self.state.battery.is_finite()
    }

    /// True if the satellite meets all conditions of BSK-RL's aliveness checkers.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.failures().is_empty()
    }

    /// Names of BSK-RL's aliveness checkers that fail.
    #[must_use]
    pub fn failures(&self) -> Vec<&'static str> {
        let args = &self.spec.args;
        let max_speed = args.max_wheel_speed_rpm * RAD_S_PER_RPM;
        let level = self.state.stored + self.initial_stored;
        let capacity = args.storage_capacity_bits.floor();
        let is_full = level >= capacity && (level - capacity).abs() > 1e-8 + 1e-5 * capacity;
        [
            ("altitude_valid", norm(&self.state.position) > args.min_orbital_radius_m),
            ("battery_valid", self.state.battery > 0.0),
            ("data_storage_valid", !(args.storage_valid_check && self.spec.dynamics.instrument && is_full)),
            ("rw_speeds_valid", self.state.attitude.wheels.iter().all(|speed| speed.abs() < max_speed)),
        ]
        .into_iter()
        .filter_map(|(name, holds)| (!holds).then_some(name))
        .collect()
    }

    /// Times for which the thrusters were commanded to fire at a tick, s.
    #[must_use]
    pub fn commanded_thrust(&self, tick: u64) -> [f64; super::constants::THRUSTERS] {
        self.desaturation.commanded_at(tick)
    }

    /// Velocity after a tick, m/s. The orbit extends to it.
    #[must_use]
    pub fn velocity(&self, now: u64) -> Vector3<f64> {
        let time = self.environment.tick.time_s(now);
        self.orbit.arc(time).velocity(time)
    }

    /// The ground stations with their windows up to a time, s.
    pub(crate) fn stations_to(&mut self, seconds: f64, sky: &mut Sky) -> &LocationSet {
        self.track.extend_to(seconds, &mut self.orbit, sky);
        self.stations.search_to(seconds, &self.track);
        &self.stations
    }

    /// The orbit as computed so far.
    pub(crate) const fn orbit(&self) -> &Orbit {
        &self.orbit
    }

    /// The orbit, to extend it.
    pub(crate) const fn orbit_mut(&mut self) -> &mut Orbit {
        &mut self.orbit
    }

    /// Settings of the desaturation of the wheels.
    pub(crate) const fn desaturation_settings(&self) -> DesaturationSettings {
        let args = &self.spec.args;
        DesaturationSettings {
            min_momentum: args.desat_min_momentum,
            max_counter: args.desat_max_counter,
            min_fire_s: args.thruster_min_fire_s,
            full_thrust: self.environment.full_thrust,
        }
    }

    fn transmitter_settings(&self) -> TransmitterSettings {
        let args = &self.spec.args;
        TransmitterSettings {
            baud: args.transmitter_baud,
            packet_bits: args.transmitter_packet_bits.unwrap_or(-args.instrument_bits),
        }
    }
}
