//! The loop over ticks.

use pulp::Simd;

use super::attitude::{Attitude, Torques, body_from_inertial};
use super::control::{Gains, clamp, feedback, steering};
use super::guidance::{Boresight, Guidance, align_with_hill, point_at};
use super::parts::TickConstants;
use super::state::{SoftwareInputs, TickInputs, TickState};
use crate::tasking::constants::MAX_WHEEL_SPEED_RAD_S;
use crate::tasking::pack::{Pack, PackMask};
use crate::tasking::real::Real;
use crate::tasking::vector3::{Matrix3, Vector3, dot, each_axis, rotate_back, select, sub};

/// Runs up to `ticks` ticks, and stops after a tick in which an awaited image was stored. Returns the number of ticks.
#[inline(always)]
pub fn run_ticks<S: Simd, const N: usize, const W: usize>(
    simd: S,
    memory: &mut TickState<[f64; W]>,
    inputs: &TickInputs<[f64; W]>,
    constants: &TickConstants,
    ticks: u32,
) -> u32 {
    let lanes = Lanes::<S, N, W> { simd, inputs, constants };
    let mut state = lanes.load(memory);
    let mut done = 0;
    while done < ticks {
        done += 1;
        if lanes.tick(&mut state) {
            break;
        }
    }
    lanes.store(&state, memory);
    done
}

/// Numbers of `W` lanes in `N` registers, with the inputs of a block.
#[derive(Clone, Copy)]
struct Lanes<'a, S: Simd, const N: usize, const W: usize> {
    simd: S,
    inputs: &'a TickInputs<[f64; W]>,
    constants: &'a TickConstants,
}

type Number<S, const N: usize> = Pack<S, N>;

impl<S: Simd, const N: usize, const W: usize> Lanes<'_, S, N, W> {
    #[inline(always)]
    fn number(&self, values: &[f64; W]) -> Number<S, N> {
        Pack::load(self.simd, values)
    }

    #[inline(always)]
    fn vector(&self, values: &[[f64; W]; 3]) -> Vector3<Number<S, N>> {
        [self.number(&values[0]), self.number(&values[1]), self.number(&values[2])]
    }

    #[inline(always)]
    fn constant(&self, value: f64) -> Number<S, N> {
        Pack::splat(self.simd, value)
    }

    #[inline(always)]
    fn mask(&self, values: &[f64; W]) -> PackMask<S, N> {
        self.is_true(self.number(values))
    }

    #[inline(always)]
    fn is_true(&self, value: Number<S, N>) -> PackMask<S, N> {
        self.constant(0.5).less_than(value)
    }

    /// Loads the state of all lanes into registers.
    #[inline(always)]
    fn load(&self, memory: &TickState<[f64; W]>) -> TickState<Number<S, N>> {
        let attitude = &memory.attitude;
        TickState {
            attitude: Attitude {
                sigma: self.vector(&attitude.sigma),
                omega: self.vector(&attitude.omega),
                wheels: self.vector(&attitude.wheels),
            },
            motor: self.vector(&memory.motor),
            command: self.vector(&memory.command),
            previous_sigma: self.vector(&memory.previous_sigma),
            is_first: self.number(&memory.is_first),
            integral: self.vector(&memory.integral),
            position: self.vector(&memory.position),
            arc_time: self.number(&memory.arc_time),
            earth_cos: self.number(&memory.earth_cos),
            earth_sin: self.number(&memory.earth_sin),
            battery: self.number(&memory.battery),
            net_power: self.number(&memory.net_power),
            stored: self.number(&memory.stored),
            is_commanded: self.number(&memory.is_commanded),
            is_imaged: self.number(&memory.is_imaged),
        }
    }

    /// Stores the state of all lanes.
    #[inline(always)]
    fn store(&self, state: &TickState<Number<S, N>>, memory: &mut TickState<[f64; W]>) {
        for i in 0..3 {
            state.attitude.sigma[i].store(&mut memory.attitude.sigma[i]);
            state.attitude.omega[i].store(&mut memory.attitude.omega[i]);
            state.attitude.wheels[i].store(&mut memory.attitude.wheels[i]);
            state.motor[i].store(&mut memory.motor[i]);
            state.command[i].store(&mut memory.command[i]);
            state.previous_sigma[i].store(&mut memory.previous_sigma[i]);
            state.integral[i].store(&mut memory.integral[i]);
            state.position[i].store(&mut memory.position[i]);
        }
        state.is_first.store(&mut memory.is_first);
        state.arc_time.store(&mut memory.arc_time);
        state.earth_cos.store(&mut memory.earth_cos);
        state.earth_sin.store(&mut memory.earth_sin);
        state.battery.store(&mut memory.battery);
        state.net_power.store(&mut memory.net_power);
        state.stored.store(&mut memory.stored);
        state.is_commanded.store(&mut memory.is_commanded);
        state.is_imaged.store(&mut memory.is_imaged);
    }

    /// Runs one tick. Returns true if an awaited image was stored in it.
    #[inline(always)]
    fn tick(&self, state: &mut TickState<Number<S, N>>) -> bool {
        let parts = self.constants.parts;
        let time = state.arc_time.plus(self.constants.step);
        let location = self.location(state, time);
        let has_access = self.has_access(state, &location);
        self.advance_body(state);
        let position = self.position(time);
        let body = body_from_inertial(&state.attitude.sigma);
        let sun = self.sun(time);
        self.advance_battery(state, &body, &sub(&sun, &position));
        let is_awaited_stored = parts.storing && self.store_data(state);
        let guidance = self.guide(state, &body, &location, &position, time);
        if parts.triggering {
            self.trigger(state, &guidance, has_access);
        }
        self.control(state, &guidance);
        state.position = position;
        state.arc_time = time;
        let [turn_cos, turn_sin] = self.constants.earth_turn;
        let (cos, sin) = (state.earth_cos, state.earth_sin);
        state.earth_cos = cos.times(turn_cos) - sin.times(turn_sin);
        state.earth_sin = sin.times(turn_cos) + cos.times(turn_sin);
        is_awaited_stored
    }

    /// Location at which the boresight points: one on the ground as the Earth was at the last tick, or the Sun now.
    #[inline(always)]
    fn location(&self, state: &TickState<Number<S, N>>, time: Number<S, N>) -> Vector3<Number<S, N>> {
        let [by_cos, by_sin, fixed, rate] = &self.inputs.software.location;
        each_axis!(
            i => self.number(&fixed[i])
                + state.earth_cos * self.number(&by_cos[i])
                + state.earth_sin * self.number(&by_sin[i])
                + time * self.number(&rate[i])
        )
    }

    /// True in lanes whose target sees the satellite above the least elevation and within range, both at the last tick
    /// (Basilisk's `groundLocation`). Signed squares replace the arcsine.
    #[inline(always)]
    fn has_access(
        &self,
        state: &TickState<Number<S, N>>,
        location: &Vector3<Number<S, N>>,
    ) -> PackMask<S, N> {
        let software = &self.inputs.software;
        let from_target = sub(&state.position, location);
        let (height, range_2) = (dot(&from_target, location), dot(&from_target, &from_target));
        let limit = self.number(&software.elevation_sine_2) * self.number(&software.location_2) * range_2;
        limit.less_than(height * height.magnitude()) & range_2.at_most(self.number(&software.max_range_2))
    }

    /// Dynamics: attitude and wheels under the torques of the last tick, then the torques of the next one.
    #[inline(always)]
    fn advance_body(&self, state: &mut TickState<Number<S, N>>) {
        let body = &self.inputs.body;
        let torques = Torques {
            motor: state.motor,
            disturbance: self.vector(&body.disturbance),
            initial: self.vector(&body.thrust),
        };
        let (inertia, inverse) = (self.vector(&body.hub_inertia), self.vector(&body.inverse_hub_inertia));
        state.attitude.advance(&torques, &inertia, &inverse, self.constants.step);
        let (max_motor, max_speed) = (self.number(&body.max_motor), self.constant(MAX_WHEEL_SPEED_RAD_S));
        let zero = self.constant(0.0);
        for i in 0..3 {
            let torque = clamp(state.command[i], max_motor);
            let speed = state.attitude.wheels[i];
            let is_saturated = max_speed.at_most(speed.magnitude()) & zero.at_most(speed * torque);
            state.motor[i] = Pack::select(is_saturated, zero, torque);
        }
    }

    /// Position on the orbit's arc, m.
    #[inline(always)]
    fn position(&self, time: Number<S, N>) -> Vector3<Number<S, N>> {
        let arc = &self.inputs.sky.arc;
        each_axis!(i => {
            let mut sum = self.number(&arc[i][5]);
            for power in [4, 3, 2, 1, 0] {
                sum = sum * time + self.number(&arc[i][power]);
            }
            sum
        })
    }

    /// Velocity on the orbit's arc, m/s.
    #[inline(always)]
    fn velocity(&self, time: Number<S, N>) -> Vector3<Number<S, N>> {
        let arc = &self.inputs.sky.arc;
        each_axis!(i => {
            let mut sum = self.number(&arc[i][5]).times(5.0);
            for power in [4_u8, 3, 2, 1] {
                sum = sum * time + self.number(&arc[i][usize::from(power)]).times(f64::from(power));
            }
            sum
        })
    }

    /// Position of the Sun, m.
    #[inline(always)]
    fn sun(&self, time: Number<S, N>) -> Vector3<Number<S, N>> {
        let (sun, rate) = (&self.inputs.sky.sun, &self.inputs.sky.sun_rate);
        each_axis!(i => self.number(&sun[i]) + time * self.number(&rate[i]))
    }

    /// Power of panel, wheels and sinks, integrated into the battery (Basilisk's `simpleSolarPanel`, `ReactionWheelPower`,
    /// `simplePowerSink` and `simpleBattery`).
    #[inline(always)]
    fn advance_battery(
        &self,
        state: &mut TickState<Number<S, N>>,
        body: &Matrix3<Number<S, N>>,
        to_sun: &Vector3<Number<S, N>>,
    ) {
        let supply = &self.inputs.supply;
        let zero = self.constant(0.0);
        let normal = rotate_back(body, &self.vector(&supply.panel_normal));
        let distance_2 = dot(to_sun, to_sun);
        let projection = dot(&normal, to_sun).larger(zero);
        let lit = self.number(&supply.panel_strength) * self.number(&self.inputs.sky.illumination);
        let panel = lit * projection / (distance_2 * distance_2.sqrt());
        let (gain, back) = (self.number(&supply.wheel_gain), self.number(&supply.wheel_return));
        let mut net = panel + self.number(&supply.sinks);
        for i in 0..3 {
            let mechanical = state.attitude.wheels[i] * state.motor[i];
            net = net - mechanical * Pack::select(zero.less_than(mechanical), gain, back);
        }
        let charge = state.battery + net.times(self.constants.step);
        state.battery = charge.smaller(self.number(&supply.battery_capacity)).larger(zero);
        state.net_power = net;
    }

    /// Stores the data of instruments that were commanded in the last tick. Returns true if an awaited image was stored.
    #[inline(always)]
    fn store_data(&self, state: &mut TickState<Number<S, N>>) -> bool {
        let supply = &self.inputs.supply;
        let filled = state.stored + self.number(&supply.instrument_bits);
        let is_stored = self.is_true(state.is_commanded)
            & self.mask(&supply.is_listening)
            & filled.at_most(self.number(&supply.storage_room));
        state.stored = Pack::select(is_stored, filled, state.stored);
        let awaited = self.number(&supply.awaited_bits);
        awaited.any(awaited.less_than(state.stored))
    }

    /// Guidance of the lanes' modes. Without one, the reference is the inertial frame (a zeroed `attRef` message).
    #[inline(always)]
    fn guide(
        &self,
        state: &mut TickState<Number<S, N>>,
        body: &Matrix3<Number<S, N>>,
        location: &Vector3<Number<S, N>>,
        position: &Vector3<Number<S, N>>,
        time: Number<S, N>,
    ) -> Guidance<Number<S, N>> {
        let (software, parts) = (&self.inputs.software, self.constants.parts);
        let zero = self.constant(0.0);
        let (sigma, omega) = (state.attitude.sigma, state.attitude.omega);
        let mut guidance = Guidance {
            sigma_error: sigma,
            omega_error: omega,
            omega_reference: [zero; 3],
            omega_rate_reference: [zero; 3],
        };
        if parts.pointing {
            let boresight = Boresight {
                axis: self.vector(&software.boresight.axis),
                opposite_axis: self.vector(&software.boresight.opposite_axis),
            };
            let is_first = self.is_true(state.is_first);
            let to_location = sub(location, position);
            let pointed = point_at(
                &boresight,
                &to_location,
                body,
                &omega,
                &state.previous_sigma,
                is_first,
                self.constants.step,
            );
            let is_pointing = self.mask(&software.is_pointing);
            guidance = Guidance::select(is_pointing, &pointed, &guidance);
            state.previous_sigma = select(is_pointing, &pointed.sigma_error, &state.previous_sigma);
            state.is_first = Pack::select(is_pointing, zero, state.is_first);
        }
        if parts.hill {
            let aligned = align_with_hill(&sigma, body, &omega, position, &self.velocity(time));
            guidance = Guidance::select(self.mask(&software.is_hill), &aligned, &guidance);
        }
        guidance
    }

    /// Commands the instruments whose errors are within tolerance and whose target has access (Basilisk's
    /// `simpleInstrumentController` and `scanningInstrumentController`).
    #[inline(always)]
    fn trigger(
        &self,
        state: &mut TickState<Number<S, N>>,
        guidance: &Guidance<Number<S, N>>,
        has_access: PackMask<S, N>,
    ) {
        let software = &self.inputs.software;
        let (zero, one) = (self.constant(0.0), self.constant(1.0));
        let (sigma, omega) = (&guidance.sigma_error, &guidance.omega_error);
        let is_imager = self.mask(&software.is_imager);
        let is_ready = has_access
            & dot(sigma, sigma).at_most(self.number(&software.attitude_tolerance_2))
            & dot(omega, omega).at_most(self.number(&software.rate_tolerance_2))
            & !(is_imager & self.is_true(state.is_imaged));
        let is_triggering = self.mask(&software.is_triggering);
        let command = Pack::select(is_ready, one, zero);
        state.is_commanded = Pack::select(is_triggering, command, state.is_commanded);
        state.is_imaged = Pack::select(is_triggering & is_imager & is_ready, one, state.is_imaged);
    }

    /// Motor torque commands of the control laws. Uncontrolled wheels keep the last command.
    #[inline(always)]
    fn control(&self, state: &mut TickState<Number<S, N>>, guidance: &Guidance<Number<S, N>>) {
        let (software, parts) = (&self.inputs.software, self.constants.parts);
        let inertia = self.vector(&self.inputs.body.inertia);
        let gains = self.gains(software);
        let step = self.number(&software.control_step);
        let omega = state.attitude.omega;
        let mut command = state.command;
        let mut integral = state.integral;
        if parts.feedback {
            command = feedback(&gains, guidance, &omega, &inertia, &mut integral, step);
        }
        if parts.steering {
            let mut steered_integral = state.integral;
            let wheels = state.attitude.wheels;
            let steered = steering(&gains, guidance, &omega, &wheels, &inertia, &mut steered_integral, step);
            let is_steering = self.mask(&software.is_steering);
            command = select(is_steering, &steered, &command);
            integral = select(is_steering, &steered_integral, &integral);
        }
        let is_controlled = self.mask(&software.is_controlled);
        state.command = select(is_controlled, &command, &state.command);
        state.integral = select(is_controlled, &integral, &state.integral);
    }

    #[inline(always)]
    fn gains(&self, software: &SoftwareInputs<[f64; W]>) -> Gains<Number<S, N>> {
        let gains = &software.gains;
        Gains {
            proportional: self.number(&gains.proportional),
            cubic: self.number(&gains.cubic),
            max_rate: self.number(&gains.max_rate),
            rate: self.number(&gains.rate),
            integral: self.number(&gains.integral),
            integral_limit: self.number(&gains.integral_limit),
        }
    }
}
