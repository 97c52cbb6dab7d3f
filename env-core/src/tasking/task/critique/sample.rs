//! Samples of every tick: power by cause, storage and place on the orbit.

use super::orbit_angle::orbit_angle_deg;
use crate::tasking::constants::RAD_S_PER_RPM;
use crate::tasking::satellite::TaskedSatellite;
use crate::tasking::simulation::TaskingSim;
use crate::tasking::vector3::{Vector3, add, norm, scale, sub};

/// Visible share of the Sun below which a satellite counts as in eclipse.
const DARK_SHARE: f64 = 0.01;

/// Weight of the first stage of the Runge–Kutta method, the only one in which thrusters act.
const THRUST_STAGE: f64 = 1.0 / 6.0;

/// State of a satellite after a tick, and what happened in the tick. Losses of power are relative to a panel that points at the Sun
/// outside the shadow of the Earth.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TickSample {
    /// Orbit angle from local noon, degrees.
    pub orbit_angle_deg: f32,
    /// Charge of the battery, J.
    pub battery_j: f32,
    /// Power that the shadow of the Earth took from the panel, W.
    pub eclipse_w: f32,
    /// Power that the panel lost by not pointing at the Sun, W.
    pub mispointing_w: f32,
    /// Power that the thrusters drew, W.
    pub thrusters_w: f32,
    /// Power that the wheels drew, W; negative while they return some.
    pub wheels_w: f32,
    /// Power that all other devices drew, W.
    pub devices_w: f32,
    /// Speed of the fastest wheel as a share of the limit.
    pub wheel_share: f32,
    /// True in the shadow of the Earth.
    pub is_dark: bool,
    /// True if the battery is full.
    pub is_charged: bool,
    /// True if the storage has no room for the data of a tick.
    pub is_full: bool,
    /// True if data were recorded in the tick that the storage had no room for.
    pub is_rejected: bool,
    /// True if data were sent in the tick.
    pub has_sent: bool,
    /// True if the transmitter was on.
    pub is_transmitting: bool,
    /// True if the storage holds at least a packet.
    pub has_data: bool,
}

/// Samples the ticks of one satellite.
#[derive(Debug, Clone)]
pub(super) struct SatelliteRecorder {
    /// Samples by tick; the first is that of the start.
    pub samples: Vec<TickSample>,
    /// Angular momentum that the thrusters added so far, in body axes, N·m·s.
    pub thruster_impulse: Vector3<f64>,
    /// State after the last tick: command to the instrument, and bits of both partitions.
    was_commanded: bool,
    stored: [f64; 2],
}

impl SatelliteRecorder {
    /// Creates a recorder with a sample of the current moment, in which no power flows.
    pub(super) fn new(sim: &TaskingSim, index: usize, sun: &Vector3<f64>) -> Self {
        let mut recorder = Self {
            samples: Vec::new(),
            thruster_impulse: [0.0; 3],
            was_commanded: false,
            stored: sim.satellite(index).stored(),
        };
        recorder.record(sim, index, sun);
        recorder
    }

    /// Adds the sample of the last tick.
    pub(super) fn record(&mut self, sim: &TaskingSim, index: usize, sun: &Vector3<f64>) {
        let satellite = sim.satellite(index);
        let (state, args, software) = (&satellite.state, &satellite.spec().args, satellite.software());
        let illumination = sim.illumination(index);
        let power = match sim.now() {
            0 => PowerBalance { illumination, ..PowerBalance::default() },
            _ => PowerBalance::of(satellite, sun, illumination),
        };
        let [stored, initial] = satellite.stored();
        let (bits, capacity) = (args.instrument_bits.round(), args.storage_capacity_bits.floor());
        let packet = args.transmitter_packet_bits.map_or(args.instrument_bits, f64::abs);
        let is_rejected = self.was_commanded
            && software.is_listening
            && satellite.spec().dynamics.instrument
            && self.stored[0] + bits > capacity - self.stored[1];
        let limit = args.max_wheel_speed_rpm * RAD_S_PER_RPM;
        let fastest = state.attitude.wheels.iter().fold(0.0, |max: f64, speed| max.max(speed.abs()));
        self.samples.push(TickSample {
            orbit_angle_deg: orbit_angle_deg(&state.position, &satellite.velocity(sim.now()), sun) as f32,
            battery_j: state.battery as f32,
            eclipse_w: power.eclipse_w as f32,
            mispointing_w: power.mispointing_w as f32,
            thrusters_w: power.thrusters_w as f32,
            wheels_w: power.wheels_w as f32,
            devices_w: power.devices_w as f32,
            wheel_share: (fastest / limit) as f32,
            is_dark: power.illumination < DARK_SHARE,
            is_charged: state.battery >= args.battery_capacity_ws,
            is_full: stored + initial + bits > capacity,
            is_rejected,
            has_sent: stored + initial < self.stored[0] + self.stored[1],
            is_transmitting: software.transmitter_on,
            has_data: stored.max(initial) >= packet,
        });
        self.was_commanded = state.is_commanded > 0.5;
        self.stored = [stored, initial];
        if let Some(pulse) = satellite.pending_pulse().filter(|pulse| pulse.tick == sim.now() + 1) {
            self.thruster_impulse = add(&self.thruster_impulse, &scale(&pulse.torque, THRUST_STAGE));
        }
    }
}

/// Power of a satellite in a tick, by cause, W.
#[derive(Default)]
struct PowerBalance {
    eclipse_w: f64,
    mispointing_w: f64,
    thrusters_w: f64,
    wheels_w: f64,
    devices_w: f64,
    /// Visible share of the Sun.
    illumination: f64,
}

impl PowerBalance {
    /// Splits the net power of the last tick, which is that of panel, devices and wheels.
    fn of(satellite: &TaskedSatellite, sun: &Vector3<f64>, illumination: f64) -> Self {
        let (state, args, software) = (&satellite.state, &satellite.spec().args, satellite.software());
        let when = |is_on: bool, power: f64| if is_on { -power } else { 0.0 };
        let thrusters_w = when(software.thrusters_on, args.thruster_power_w);
        let devices_w = -args.base_power_w
            + when(software.instrument_on, args.instrument_power_w)
            + when(software.transmitter_on, args.transmitter_power_w);
        let gain = 1.0 / args.wheel_elec_to_mech;
        let back = if args.wheel_mech_to_elec < 0.0 { -gain } else { args.wheel_mech_to_elec };
        let mechanical = state.attitude.wheels.iter().zip(&state.motor).map(|(speed, torque)| speed * torque);
        let driven: f64 = mechanical.map(|power| power * if power > 0.0 { gain } else { back }).sum();
        let wheels_w = 3.0 * args.wheel_base_power_w + driven;
        let panel_w = satellite.net_power_w() + thrusters_w + devices_w + wheels_w;
        let to_sun = sub(sun, &state.position);
        let full_w = args.facing_panel_w(norm(&to_sun));
        Self {
            eclipse_w: full_w * (1.0 - illumination),
            mispointing_w: (full_w * illumination - panel_w).max(0.0),
            thrusters_w,
            wheels_w,
            devices_w,
            illumination,
        }
    }
}
