//! Inputs of a satellite's lane, and how long they hold.

use super::TaskedSatellite;
use super::desaturation::Pulse;
use super::eclipse::{constant_illumination, illumination};
use super::software::PointingTarget;
use crate::tasking::constants::{ASTRONOMICAL_UNIT_M, SOLAR_FLUX_W_M2, WHEEL_INERTIA_KG_M2};
use crate::tasking::orbit::Sky;
use crate::tasking::orbit::propagator::STEP_S;
use crate::tasking::tick::block::Block;
use crate::tasking::tick::parts::BlockParts;
use crate::tasking::vector3::{Vector3, cross, dot, norm, scale, sub};

/// Inputs that were computed ahead.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct RefreshCache {
    /// Arc that is in the lane.
    arc: Option<usize>,
    illumination: f64,
    /// Last tick for which `illumination` holds.
    illumination_until: u64,
    /// First tick whose downlink is computed after a run of ticks; `None` outside of passes.
    downlinked_from: Option<u64>,
}

impl TaskedSatellite {
    /// Loads the satellite into a lane after the tick `now`. Returns the last tick for which the inputs hold.
    pub fn load<const W: usize>(
        &mut self,
        now: u64,
        block: &mut Block<W>,
        lane: usize,
        sky: &mut Sky,
    ) -> u64 {
        block.load(lane, &self.state);
        self.fill_body(block, lane);
        self.fill_supply(block, lane);
        self.fill_software(block, lane);
        self.cache.arc = None;
        self.refresh(now, block, lane, sky)
    }

    /// Sets the inputs of the ticks after `now`. Returns the last tick for which they hold.
    pub fn refresh<const W: usize>(
        &mut self,
        now: u64,
        block: &mut Block<W>,
        lane: usize,
        sky: &mut Sky,
    ) -> u64 {
        let tick = self.environment.tick;
        let next = now + 1;
        let arc = tick.arc_of(next, STEP_S);
        if self.cache.arc != Some(arc) {
            self.fill_arc(now, arc, block, lane, sky);
        }
        let mut until = tick.last_tick_of(arc, STEP_S).max(next);
        if next > self.cache.illumination_until {
            self.find_illumination(next, until, sky);
        }
        block.inputs.sky.illumination[lane] = self.cache.illumination;
        until = until.min(self.cache.illumination_until);
        until = until.min(self.fill_thrust(next, block, lane));
        until = until.min(self.fill_control_step(next, block, lane));
        if let Some(tick) = self.desaturation.next_tick() {
            until = until.min(tick.max(next));
        }
        self.cache.downlinked_from = None;
        if self.software.transmitter_on {
            until = until.min(self.last_tick_of_access(next, sky));
        }
        until.max(next)
    }

    /// Runs what follows the tick `now`, the last one for which the inputs held. `stored_before` are the stored bits before it.
    pub fn finish_tick<const W: usize>(
        &mut self,
        now: u64,
        block: &mut Block<W>,
        lane: usize,
        stored_before: f64,
        sky: &mut Sky,
    ) {
        let tick = self.environment.tick;
        if self.desaturation.next_tick().is_some_and(|tick| tick <= now) {
            let wheels = block.state.attitude.wheels.map(|lanes| lanes[lane]);
            let settings = self.desaturation_settings();
            self.desaturation.update(now, tick.seconds(), &wheels, &settings);
        }
        if self.software.transmitter_on {
            let settings = self.transmitter_settings();
            let mut stored_before = stored_before;
            for at in self.cache.downlinked_from.unwrap_or(now)..=now {
                let has_access = self.has_station_access(tick.time_s(at.saturating_sub(1)), sky);
                let stored = [stored_before, self.initial_stored];
                let change =
                    self.transmitter.tick(tick.time_s(at), tick.seconds(), has_access, stored, &settings);
                block.state.stored[lane] = (block.state.stored[lane] + change[0]).max(0.0);
                self.initial_stored = (self.initial_stored + change[1]).max(0.0);
                stored_before = block.state.stored[lane];
            }
            if let Some(from) = &mut self.cache.downlinked_from {
                *from = now + 1;
            }
            self.fill_storage_room(block, lane);
        }
    }

    /// True if ticks ran in a pass whose downlinks are not computed yet.
    pub const fn awaits_downlink(&self) -> bool {
        self.cache.downlinked_from.is_some()
    }

    /// Follows the ticks up to this one, in which no ground station was in reach.
    pub fn skip_transmitter_to(&mut self, now: u64) {
        if self.software.transmitter_on && !self.awaits_downlink() {
            self.transmitter.skip_to(self.environment.tick.time_s(now));
        }
    }

    fn fill_body<const W: usize>(&self, block: &mut Block<W>, lane: usize) {
        let body = &mut block.inputs.body;
        let inertia = self.spec.args.inertia();
        for (i, inertia) in inertia.into_iter().enumerate() {
            let hub = inertia - WHEEL_INERTIA_KG_M2;
            body.inertia[i][lane] = inertia;
            body.hub_inertia[i][lane] = hub;
            body.inverse_hub_inertia[i][lane] = 1.0 / hub;
            body.disturbance[i][lane] = self.spec.args.disturbance_n_m[i];
        }
        let max_motor = self.spec.args.u_max_n_m;
        body.max_motor[lane] = if max_motor > 0.0 { max_motor } else { f64::INFINITY };
    }

    fn fill_supply<const W: usize>(&self, block: &mut Block<W>, lane: usize) {
        let (args, software) = (&self.spec.args, &self.software);
        let supply = &mut block.inputs.supply;
        let flux = SOLAR_FLUX_W_M2 * ASTRONOMICAL_UNIT_M * ASTRONOMICAL_UNIT_M;
        supply.panel_strength[lane] = flux * args.panel_area_m2 * args.panel_efficiency;
        let length = norm(&args.panel_normal);
        for i in 0..3 {
            supply.panel_normal[i][lane] = args.panel_normal[i] / length;
        }
        let when = |is_on: bool, power: f64| if is_on { power } else { 0.0 };
        supply.sinks[lane] = args.base_power_w
            + when(software.thrusters_on, args.thruster_power_w)
            + when(software.instrument_on, args.instrument_power_w)
            + when(software.transmitter_on, args.transmitter_power_w)
            - 3.0 * args.wheel_base_power_w;
        let gain = 1.0 / args.wheel_elec_to_mech;
        let back = args.wheel_mech_to_elec;
        supply.wheel_gain[lane] = gain;
        supply.wheel_return[lane] = if back < 0.0 { -gain } else { back };
        supply.battery_capacity[lane] = args.battery_capacity_ws;
        let step = self.environment.tick.seconds();
        // The data of an image are those of one tick, whatever its length.
        let bits = if self.spec.dynamics.continuous {
            args.instrument_bits * step
        } else {
            (args.instrument_bits / step) * step
        };
        supply.instrument_bits[lane] = bits.round();
        let is_listening = self.spec.dynamics.instrument && software.is_listening;
        supply.is_listening[lane] = f64::from(u8::from(is_listening));
        supply.awaited_bits[lane] = self.awaited_bits.unwrap_or(f64::INFINITY);
        self.fill_storage_room(block, lane);
    }

    /// Data may fill the storage, not exceed it.
    fn fill_storage_room<const W: usize>(&self, block: &mut Block<W>, lane: usize) {
        let capacity = self.spec.args.storage_capacity_bits.floor();
        block.inputs.supply.storage_room[lane] = capacity - self.initial_stored;
    }

    fn fill_software<const W: usize>(&self, block: &mut Block<W>, lane: usize) {
        let (args, software, model) = (&self.spec.args, &self.software, self.spec.software);
        let inputs = &mut block.inputs.software;
        let flag = |is_true: bool| f64::from(u8::from(is_true));
        inputs.is_pointing[lane] = flag(software.pointing.is_some());
        inputs.is_hill[lane] = flag(software.is_hill);
        inputs.is_steering[lane] = flag(model.steering);
        inputs.is_controlled[lane] = flag(software.is_controlled);
        inputs.is_triggering[lane] = flag(software.is_triggering);
        inputs.is_imager[lane] = flag(!model.continuous);
        let axis = match software.pointing {
            Some(PointingTarget::Location(_)) => args.instrument_axis,
            _ => args.panel_normal,
        };
        let axis = scale(&axis, 1.0 / norm(&axis));
        let opposite = opposite_axis(&axis);
        for i in 0..3 {
            inputs.boresight.axis[i][lane] = axis[i];
            inputs.boresight.opposite_axis[i][lane] = opposite[i];
        }
        let sine = if model.continuous { -1.0 } else { libm::sin(args.target_min_elevation_rad) };
        inputs.elevation_sine_2[lane] = sine * sine.abs();
        let range = args.target_max_range_m;
        inputs.max_range_2[lane] = if range < 0.0 { f64::INFINITY } else { range * range };
        inputs.attitude_tolerance_2[lane] = args.attitude_tolerance * args.attitude_tolerance;
        let rate = args.rate_tolerance_rad_s.unwrap_or(f64::INFINITY);
        inputs.rate_tolerance_2[lane] = rate * rate;
        let gains = &mut inputs.gains;
        let (proportional, rate, integral) = if model.steering {
            (args.steering_k1, args.servo_p, args.servo_ki)
        } else {
            (args.feedback_k, args.feedback_p, args.feedback_ki)
        };
        gains.proportional[lane] = proportional;
        gains.cubic[lane] = args.steering_k3;
        gains.max_rate[lane] = args.omega_max_rad_s;
        gains.rate[lane] = rate;
        gains.integral[lane] = integral;
        gains.integral_limit[lane] = if integral > 0.0 { 2.0 / integral * 0.1 } else { 0.0 };
        block.parts[lane] = BlockParts {
            pointing: software.pointing.is_some(),
            hill: software.is_hill,
            steering: model.steering && software.is_controlled,
            feedback: !model.steering && software.is_controlled,
            triggering: software.is_triggering,
            storing: self.spec.dynamics.instrument
                && software.is_listening
                && (software.is_triggering || self.state.is_commanded > 0.5),
        };
    }

    /// Loads an arc of the orbit, the Sun, and the location at which the boresight points.
    fn fill_arc<const W: usize>(
        &mut self,
        now: u64,
        arc: usize,
        block: &mut Block<W>,
        lane: usize,
        sky: &mut Sky,
    ) {
        self.cache.arc = Some(arc);
        let start = arc as f64 * STEP_S;
        let end = start + STEP_S;
        self.orbit.extend_to(end, sky);
        let path = self.orbit.arc(start);
        let (sun, sun_end) = (sky.sun(start), sky.sun(end));
        let rate = scale(&sub(&sun_end, &sun), 1.0 / STEP_S);
        let inputs = &mut block.inputs;
        for i in 0..3 {
            for power in 0..6 {
                inputs.sky.arc[i][power][lane] = path.coefficients[i][power];
            }
            inputs.sky.sun[i][lane] = sun[i];
            inputs.sky.sun_rate[i][lane] = rate[i];
        }
        let time = self.environment.tick.time_s(now);
        block.state.arc_time[lane] = time - start;
        let zero = [0.0; 3];
        let mut location = [zero; 4];
        let mut square = 0.0;
        match self.software.pointing {
            Some(PointingTarget::Sun) => (location[2], location[3]) = (sun, rate),
            Some(PointingTarget::Location(position)) => {
                let frame = sky.earth(time);
                [location[0], location[1], location[2]] = frame.turning_parts(&position);
                block.state.earth_cos[lane] = frame.cos;
                block.state.earth_sin[lane] = frame.sin;
                square = dot(&position, &position);
            }
            None => {}
        }
        for (part, vector) in block.inputs.software.location.iter_mut().zip(&location) {
            part.iter_mut().zip(vector).for_each(|(lanes, x)| lanes[lane] = *x);
        }
        block.inputs.software.location_2[lane] = square;
    }

    /// Finds the illumination of a tick and the last tick for which it holds, up to `limit`.
    ///
    /// It is that of the position one tick earlier and of the Sun now: Basilisk's world runs before the dynamics.
    fn find_illumination(&mut self, next: u64, limit: u64, sky: &Sky) {
        let tick = self.environment.tick;
        let mut path = self.orbit.arc(tick.time_s(next - 1));
        let (position, sun) = (path.position(tick.time_s(next - 1)), sky.sun(tick.time_s(next)));
        if let Some(constant) = constant_illumination(&position, &sun) {
            (self.cache.illumination, self.cache.illumination_until) = (constant, limit);
            return;
        }
        let share = illumination(&position, &sun);
        let mut until = next;
        while until < limit {
            let time = tick.time_s(until);
            if time >= path.start_s + STEP_S {
                path = self.orbit.arc(time);
            }
            if illumination(&path.position(time), &sky.sun(tick.time_s(until + 1))) != share {
                break;
            }
            until += 1;
        }
        (self.cache.illumination, self.cache.illumination_until) = (share, until);
    }

    /// Sets the thrusters' torque of the next tick. Returns the last tick for which it holds.
    fn fill_thrust<const W: usize>(&self, next: u64, block: &mut Block<W>, lane: usize) -> u64 {
        let pulse = self.desaturation.pending().filter(|pulse| pulse.tick >= next);
        let (torque, until) = match pulse {
            Some(Pulse { tick, torque }) if tick == next => (torque, next),
            Some(Pulse { tick, .. }) => ([0.0; 3], tick - 1),
            None => ([0.0; 3], u64::MAX),
        };
        for (axis, torque) in block.inputs.body.thrust.iter_mut().zip(torque) {
            axis[lane] = torque;
        }
        until
    }

    /// Sets the time since the last control. Returns the last tick for which it holds.
    fn fill_control_step<const W: usize>(&self, next: u64, block: &mut Block<W>, lane: usize) -> u64 {
        let tick = self.environment.tick;
        let is_first = self.commanded_at == Some(next - 1);
        let (step, until) = match self.last_control {
            Some(last) if is_first && last + 1 != next => (tick.time_s(next - last), next),
            None if is_first => (0.0, next),
            _ => (tick.seconds(), u64::MAX),
        };
        block.inputs.software.control_step[lane] = step;
        until
    }

    /// The last tick from `next` on that needs no look at the transmitter. In a pass, each tick needs one if data are recorded.
    fn last_tick_of_access(&mut self, next: u64, sky: &mut Sky) -> u64 {
        /// Time that is searched for the next pass, s.
        const LOOK_AHEAD_S: f64 = 600.0;
        let tick = self.environment.tick;
        let time = tick.time_s(next - 1);
        if self.has_station_access(time, sky) {
            // Nothing but the transmitter changes the data, so that its ticks can follow those of the motion.
            let is_alone = !self.software.is_listening;
            self.cache.downlinked_from = is_alone.then_some(next);
            return if is_alone { u64::MAX } else { next };
        }
        let horizon = time + LOOK_AHEAD_S;
        let stations = self.stations_to(horizon, sky);
        let windows = stations.closed_windows().iter().copied().chain(stations.open_windows());
        let opening = windows.map(|w| w.open_s).filter(|open| *open >= time).fold(horizon, f64::min);
        // Access of a tick is that of the time before it.
        tick.first_tick_at(opening).map_or(u64::MAX, |tick| tick.max(next))
    }

    /// True if any ground station sees the satellite at a time, s.
    fn has_station_access(&mut self, time: f64, sky: &mut Sky) -> bool {
        if !self.spec.dynamics.ground_stations {
            return false;
        }
        let stations = self.stations_to(time + STEP_S, sky);
        let windows = stations.closed_windows().iter().rev().copied().chain(stations.open_windows());
        windows.into_iter().any(|window| window.open_s <= time && time < window.close_s)
    }
}

/// Axis perpendicular to a boresight (`eHat180_B` of `locationPointing`).
fn opposite_axis(axis: &Vector3<f64>) -> Vector3<f64> {
    let mut normal = cross(axis, &[1.0, 0.0, 0.0]);
    if norm(&normal) < 0.1 {
        normal = cross(axis, &[0.0, 1.0, 0.0]);
    }
    scale(&normal, 1.0 / norm(&normal))
}
