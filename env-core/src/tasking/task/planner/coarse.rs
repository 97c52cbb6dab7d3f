//! The coarse model of a scanning satellite: energy, data and wheels in slots of a minute.
//!
//! The body turns the shortest way to its next direction and keeps its roll. The momentum of the wheels is fixed in space, apart from
//! the disturbance and the thrusters. Turning the body moves it from wheel to wheel, which costs power.

use super::light::panel_cosine;
use super::slew_profile::SlewProfile;
use super::slots::{SCAN_SLOTS, SLOT_S, SkySlot, SlotTable};
use crate::tasking::constants::{RAD_S_PER_RPM, WHEEL_INERTIA_KG_M2};
use crate::tasking::satellite::TaskedSatellite;
use crate::tasking::satellite::desaturation::planned_impulse;
use crate::tasking::tick::attitude::body_from_inertial;
use crate::tasking::vector3::{Matrix3, Vector3, add, cross, dot, norm, rotate, rotate_back, scale, sub};

/// Pulses of a desaturation of one slot.
const PULSES: u32 = 12;
/// Electric energy of a right-angled slew, J per squared N·m·s of the wheels' momentum, and its limit per N·m·s. Measured from
/// flown slews.
const SLEW_ENERGY: [f64; 2] = [25.0, 320.0];
/// Share of the largest wheel speed that a plan does not exceed.
const MAX_WHEEL_SHARE: f64 = 0.97;
/// Cosine of the angle between two directions above which the body does not turn: 1e-5 rad.
const SAME_COSINE: f64 = 1.0 - 5e-11;
/// Remaining share of a slew's angle below which it has ended.
const SETTLED_SHARE: f64 = 0.02;

/// An action of the scanning task, by its index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    /// Points the instrument at the Earth and scans, 180 s.
    Scan,
    /// Points the panel at the Sun, 120 s.
    Charge,
    /// Aligns with the Hill frame and sends data, 60 s.
    Downlink,
    /// Aligns with the Hill frame and fires the thrusters, 60 s.
    Desaturate,
}

/// All modes in the order of their actions.
pub(super) const MODES: [Mode; 4] = [Mode::Scan, Mode::Charge, Mode::Downlink, Mode::Desaturate];

/// A direction of the body that modes share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Pointing {
    Earth,
    Sun,
    Hill,
}

impl Mode {
    /// Number of slots that the action takes.
    pub(super) const fn slots(self) -> usize {
        match self {
            Self::Scan => SCAN_SLOTS,
            Self::Charge => 2,
            Self::Downlink | Self::Desaturate => 1,
        }
    }

    const fn pointing(self) -> Pointing {
        match self {
            Self::Scan => Pointing::Earth,
            Self::Charge => Pointing::Sun,
            Self::Downlink | Self::Desaturate => Pointing::Hill,
        }
    }
}

/// A slew in progress.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Slew {
    angle_rad: f64,
    /// Time since its start as if the wheels were at rest, s.
    elapsed_s: f64,
    /// Share of the angle that remains.
    remaining: f64,
}

/// State of the coarse model at the start of a slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CoarseState {
    /// Axes of the body in the inertial frame.
    body: Matrix3<f64>,
    /// Momentum of the wheels in the inertial frame, N·m·s.
    momentum: Vector3<f64>,
    /// Speeds of the wheels, rad/s.
    wheels: Vector3<f64>,
    /// Charge of the battery, J.
    pub(super) battery_ws: f64,
    /// Data in the storage, bits.
    pub(super) stored_bits: f64,
    /// Time that was scanned so far, s.
    pub(super) scanned_s: f64,
    /// True once the battery was empty or a wheel too fast.
    pub(super) is_dead: bool,
    pointing: Option<Pointing>,
    slew: Slew,
}

impl CoarseState {
    /// State of a satellite.
    pub(super) fn of(satellite: &TaskedSatellite) -> Self {
        let state = &satellite.state;
        let body = body_from_inertial(&state.attitude.sigma);
        Self {
            body,
            momentum: scale(&rotate_back(&body, &state.attitude.wheels), WHEEL_INERTIA_KG_M2),
            wheels: state.attitude.wheels,
            battery_ws: state.battery,
            stored_bits: state.stored,
            scanned_s: 0.0,
            is_dead: false,
            pointing: None,
            slew: Slew { angle_rad: 0.0, elapsed_s: 0.0, remaining: 0.0 },
        }
    }

    /// Largest speed of a wheel, rad/s.
    pub(super) fn fastest_wheel(&self) -> f64 {
        self.wheels.iter().fold(0.0_f64, |fastest, speed| fastest.max(speed.abs()))
    }

    /// Magnitude of the wheels' momentum, N·m·s.
    pub(super) fn momentum_size(&self) -> f64 {
        norm(&self.momentum)
    }

    fn turned_wheels(&self) -> Vector3<f64> {
        scale(&rotate(&self.body, &self.momentum), 1.0 / WHEEL_INERTIA_KG_M2)
    }

    /// Runs a slot in a mode.
    pub(super) fn step(&mut self, table: &SlotTable, index: usize, mode: Mode) {
        let slot = &table.slots[index];
        let args = &table.args;
        let pointing = mode.pointing();
        if self.pointing != Some(pointing) {
            self.pointing = Some(pointing);
            self.slew = Slew { angle_rad: self.angle_to(pointing, slot), elapsed_s: 0.0, remaining: 1.0 };
        }
        let lit_before = panel_cosine(&self.body[2], &slot.sun);
        let is_slewing = self.slew.remaining > SETTLED_SHARE;
        let (mut scan_s, mut wheel_ws, mut lit) = (SLOT_S, 0.0, lit_before);
        if is_slewing {
            let slowing = SlewProfile::slowing(self.momentum_size());
            let settling_s = table.profile.settling_s(self.slew.angle_rad);
            scan_s = (SLOT_S - (settling_s - self.slew.elapsed_s).max(0.0) * slowing).max(0.0);
            let before = self.slew;
            let elapsed_s = before.elapsed_s + SLOT_S / slowing;
            let middle = table.profile.share(before.angle_rad, before.elapsed_s + 0.5 * SLOT_S / slowing);
            let remaining = table.profile.share(before.angle_rad, elapsed_s);
            self.turn(pointing, slot, 1.0 - (middle / before.remaining).min(1.0));
            lit = panel_cosine(&self.body[2], &slot.sun);
            self.turn(pointing, slot, 1.0 - (remaining / middle.max(1e-9)).min(1.0));
            self.slew = Slew { elapsed_s, remaining, ..before };
            let turned =
                before.angle_rad * (before.remaining - remaining).max(0.0) / std::f64::consts::FRAC_PI_2;
            let size = self.momentum_size();
            wheel_ws = turned * (SLEW_ENERGY[0] * size * size).min(SLEW_ENERGY[1] * size);
        } else {
            self.turn(pointing, slot, 1.0);
            let after = self.turned_wheels();
            for (before, after) in self.wheels.iter().zip(&after) {
                let reused = if before * after > 0.0 { before * before } else { 0.0 };
                wheel_ws += WHEEL_INERTIA_KG_M2 * (after * after - reused).max(0.0);
            }
        }
        let lit_after = panel_cosine(&self.body[2], &slot.sun);
        let cosine =
            if is_slewing { (lit_before + 2.0 * lit + lit_after) * 0.25 } else { 0.5 * (lit + lit_after) };
        let mut net_ws = slot.panel_w * cosine * SLOT_S - wheel_ws;
        let devices_w = match mode {
            Mode::Scan => args.instrument_power_w,
            Mode::Charge => 0.0,
            Mode::Downlink => args.transmitter_power_w,
            Mode::Desaturate => args.thruster_power_w,
        };
        net_ws += (args.base_power_w - 3.0 * args.wheel_base_power_w + devices_w) * SLOT_S;
        self.battery_ws = (self.battery_ws + net_ws).clamp(0.0, args.battery_capacity_ws);
        self.process_data(table, slot, mode, scan_s);
        let disturbance = rotate_back(&self.body, &args.disturbance_n_m);
        self.momentum = add(&self.momentum, &scale(&disturbance, SLOT_S));
        if mode == Mode::Desaturate {
            let impulse = planned_impulse(&self.turned_wheels(), &table.desaturation, PULSES);
            self.momentum = add(&self.momentum, &rotate_back(&self.body, &impulse));
        }
        self.wheels = self.turned_wheels();
        let limit = MAX_WHEEL_SHARE * args.max_wheel_speed_rpm * RAD_S_PER_RPM;
        self.is_dead |= self.battery_ws <= 0.0 || self.fastest_wheel() > limit;
    }

    fn process_data(&mut self, table: &SlotTable, slot: &SkySlot, mode: Mode, scan_s: f64) {
        let args = &table.args;
        match mode {
            Mode::Scan => {
                let room_s =
                    ((args.storage_capacity_bits - self.stored_bits) / args.instrument_bits).max(0.0);
                let scanned_s = scan_s.min(room_s);
                self.scanned_s += scanned_s;
                self.stored_bits += scanned_s * args.instrument_bits;
            }
            Mode::Downlink => {
                self.stored_bits = (self.stored_bits + args.transmitter_baud * slot.access_s).max(0.0);
            }
            Mode::Charge | Mode::Desaturate => {}
        }
    }

    /// Angle by which the body must turn, rad.
    fn angle_to(&self, pointing: Pointing, slot: &SkySlot) -> f64 {
        let cosine = match pointing {
            Pointing::Hill => {
                let trace: f64 = self.body.iter().zip(&slot.hill).map(|(a, b)| dot(a, b)).sum();
                0.5 * (trace - 1.0)
            }
            _ => dot(&self.body[2], &direction(pointing, slot)),
        };
        libm::acos(cosine.clamp(-1.0, 1.0))
    }

    /// Turns the body by a share of the rest of its way.
    fn turn(&mut self, pointing: Pointing, slot: &SkySlot, share: f64) {
        if pointing == Pointing::Hill && share > 0.9 {
            self.body = slot.hill;
            return;
        }
        let target = if pointing == Pointing::Hill { slot.hill[2] } else { direction(pointing, slot) };
        let from = self.body[2];
        let to = if share > 0.999 { target } else { between(&from, &target, share) };
        let cosine = dot(&from, &to);
        if cosine > SAME_COSINE {
            return;
        }
        if cosine < -0.999 {
            self.body = [scale(&self.body[0], 1.0), scale(&self.body[1], -1.0), scale(&self.body[2], -1.0)];
            return;
        }
        // Rotation by the vector product of both directions (Rodrigues).
        let axis = cross(&from, &to);
        let along = cross(&axis, &self.body[0]);
        let twice = scale(&cross(&axis, &along), 1.0 / (1.0 + cosine));
        let x = add(&add(&self.body[0], &along), &twice);
        // The small errors of x do not add up.
        let x = sub(&x, &scale(&to, dot(&x, &to)));
        let x = scale(&x, 1.0 / norm(&x));
        self.body = [x, cross(&to, &x), to];
    }
}

fn direction(pointing: Pointing, slot: &SkySlot) -> Vector3<f64> {
    match pointing {
        Pointing::Sun => scale(&slot.sun, -1.0),
        Pointing::Earth | Pointing::Hill => slot.nadir,
    }
}

/// Direction at a share of the way between two directions, by the shortest arc.
fn between(from: &Vector3<f64>, to: &Vector3<f64>, share: f64) -> Vector3<f64> {
    let cosine = dot(from, to).clamp(-1.0, 1.0);
    let sine = (1.0 - cosine * cosine).sqrt();
    if sine < 1e-6 {
        return *to;
    }
    let (turned, kept) = libm::sincos(libm::acos(cosine) * share);
    let across = scale(&sub(to, &scale(from, cosine)), 1.0 / sine);
    add(&scale(from, kept), &scale(&across, turned))
}
