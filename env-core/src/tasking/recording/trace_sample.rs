//! State of a satellite after a tick of a replay, as a trace has it.

use crate::tasking::constants::THRUSTERS;
use crate::tasking::simulation::TaskingSim;
use crate::tasking::tick::attitude::body_from_inertial;
use crate::tasking::tick::guidance::align_with_hill;
use crate::tasking::vector3::{Vector3, dot, norm, rotate, rotate_back, scale, sub};

/// A satellite as its target sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TargetView {
    /// Elevation above the target's horizon, rad.
    pub elevation_rad: f64,
    /// Distance from the target, m.
    pub range_m: f64,
    /// True if elevation and range allow an image.
    pub has_access: bool,
}

/// State of a satellite after a tick of the replay.
#[derive(Debug, Clone)]
pub(super) struct TraceSample {
    pub sigma: Vector3<f64>,
    pub omega: Vector3<f64>,
    pub wheels: Vector3<f64>,
    /// Commanded torques of the motors, N·m.
    pub command: Vector3<f64>,
    /// MRP of the body relative to the reference of the guidance, if one runs.
    pub guidance: Option<Vector3<f64>>,
    /// The tick after which the flight software received its last command.
    pub commanded_at: Option<u64>,
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub battery: f64,
    pub net_power: f64,
    pub panel_power: f64,
    pub illumination: f64,
    pub stored: f64,
    pub thruster_times: [f64; THRUSTERS],
    /// The satellite from the target of its action, as the world of the tick computes it.
    pub target: Option<TargetView>,
}

impl TraceSample {
    /// Takes the state of a satellite.
    pub(super) fn of(sim: &TaskingSim, index: usize) -> Self {
        let satellite = sim.satellite(index);
        let state = &satellite.state;
        let velocity = satellite.velocity(sim.now());
        Self {
            sigma: state.attitude.sigma,
            omega: state.attitude.omega,
            wheels: state.attitude.wheels,
            command: state.command,
            guidance: guidance_error(sim, index, &velocity),
            commanded_at: satellite.commanded_at(),
            position: state.position,
            velocity,
            battery: state.battery,
            net_power: state.net_power,
            panel_power: panel_power_w(sim, index),
            illumination: sim.illumination(index),
            stored: state.stored,
            thruster_times: satellite.commanded_thrust(sim.now()),
            target: target_view(sim, index),
        }
    }
}

/// Error of the attitude, as the flight software of this tick has it.
fn guidance_error(sim: &TaskingSim, index: usize, velocity: &Vector3<f64>) -> Option<Vector3<f64>> {
    let satellite = sim.satellite(index);
    let (state, software) = (&satellite.state, satellite.software());
    if software.is_hill {
        let attitude = &state.attitude;
        let body = body_from_inertial(&attitude.sigma);
        let guidance = align_with_hill(&attitude.sigma, &body, &attitude.omega, &state.position, velocity);
        return Some(guidance.sigma_error);
    }
    software.pointing.map(|_| state.previous_sigma)
}

/// Power of the panel in the last tick, W.
fn panel_power_w(sim: &TaskingSim, index: usize) -> f64 {
    let satellite = sim.satellite(index);
    let (state, args) = (&satellite.state, &satellite.spec().args);
    let to_sun = sub(&sim.sun_position(), &state.position);
    let distance_m = norm(&to_sun);
    let panel = rotate_back(&body_from_inertial(&state.attitude.sigma), &args.panel_normal);
    let cosine = dot(&scale(&panel, 1.0 / norm(&panel)), &to_sun) / distance_m;
    args.facing_panel_w(distance_m) * sim.illumination(index) * cosine.max(0.0)
}

/// The view from a target: the world of a tick runs before the dynamics, with the positions of the tick before.
fn target_view(sim: &TaskingSim, index: usize) -> Option<TargetView> {
    let target = sim.targets()[sim.tasked_target(index)?].position;
    let satellite = sim.satellite(index);
    let before_s = sim.tick_length().time_s(sim.now().checked_sub(1)?);
    let planet = sim.sky().earth(before_s).planet_from_inertial();
    let position = rotate(&planet, &satellite.orbit().arc(before_s).position(before_s));
    let from_target = sub(&position, &target);
    let range_m = norm(&from_target);
    let elevation_rad = libm::asin(dot(&from_target, &target) / (range_m * norm(&target)));
    let args = &satellite.spec().args;
    let is_near = args.target_max_range_m < 0.0 || range_m <= args.target_max_range_m;
    let has_access = elevation_rad > args.target_min_elevation_rad && is_near;
    Some(TargetView { elevation_rad, range_m, has_access })
}
