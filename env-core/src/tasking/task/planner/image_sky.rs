//! The episode as the planner of an imager sees it: the path, the Sun, and the windows of targets and stations.

use super::light::dark_times;
use super::slew_time::SlewTime;
use crate::tasking::access::OpportunityKind;
use crate::tasking::satellite::eclipse::illumination;
use crate::tasking::setup::SatelliteArgs;
use crate::tasking::task::run::TaskRun;
use crate::tasking::vector3::{Vector3, norm, rotate, scale, sub};

/// Time between two positions, s. A straight line between them errs by less than 20 m.
const POSITION_STEP_S: f64 = 4.0;
/// Time between two samples of the sunlight, s.
const LIGHT_STEP_S: f64 = 60.0;

/// A window of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TargetWindow {
    /// Index of the target.
    pub(super) target: usize,
    /// Time of opening, s.
    pub(super) open_s: f64,
    /// Time of closing, s.
    pub(super) close_s: f64,
    /// Value of an image.
    pub(super) priority: f64,
    /// Planet-fixed position of the target, m.
    pub(super) position: Vector3<f64>,
}

/// Sunlight at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Light {
    /// Planet-fixed direction to the Sun.
    pub(super) sun: Vector3<f64>,
    /// Power of a panel that faces the Sun, W.
    pub(super) panel_w: f64,
    /// Time until the Sun shines again, s; 0 in sunlight.
    pub(super) dark_s: f64,
}

/// The episode of an imager.
#[derive(Debug, Clone)]
pub(super) struct ImageSky {
    /// Windows of targets in the order of their closing.
    pub(super) windows: Vec<TargetWindow>,
    /// Openings and closings of the windows of stations, s.
    pub(super) passes: Vec<[f64; 2]>,
    pub(super) args: SatelliteArgs,
    pub(super) slew_time: SlewTime,
    /// Time limit of the episode, s.
    pub(super) limit_s: f64,
    positions: Vec<Vector3<f64>>,
    lights: Vec<Light>,
}

impl ImageSky {
    /// Samples the episode of the only satellite of a run.
    pub(super) fn new(run: &TaskRun) -> Self {
        let sim = &run.sim;
        let satellite = sim.satellite(0);
        let args = satellite.spec().args.clone();
        let limit_s = sim.time_limit_s();
        let list = sim.opportunities(0);
        let windows = list.upcoming(OpportunityKind::Target, 0.0).iter().map(|window| TargetWindow {
            target: window.object,
            open_s: window.open_s,
            close_s: window.close_s,
            priority: sim.targets()[window.object].priority,
            position: sim.targets()[window.object].position,
        });
        let passes = list.upcoming(OpportunityKind::GroundStation, 0.0);
        let track = sim.search_track(0);
        let count = (limit_s / POSITION_STEP_S).ceil() as usize + 1;
        let mut lights: Vec<Light> =
            (0..=(limit_s / LIGHT_STEP_S) as usize + 1).map(|index| light(run, index, &args)).collect();
        let dark_times = dark_times(lights.iter().map(|light| light.panel_w), LIGHT_STEP_S);
        lights.iter_mut().zip(dark_times).for_each(|(light, dark_s)| light.dark_s = dark_s);
        Self {
            windows: windows.collect(),
            passes: passes.iter().map(|pass| [pass.open_s, pass.close_s]).collect(),
            slew_time: SlewTime::new(&args),
            args,
            limit_s,
            positions: (0..count).map(|index| track.position(index as f64 * POSITION_STEP_S)).collect(),
            lights,
        }
    }

    /// Planet-fixed position of the satellite, m.
    pub(super) fn position(&self, seconds: f64) -> Vector3<f64> {
        let at = (seconds / POSITION_STEP_S).max(0.0);
        let index = (at as usize).min(self.positions.len() - 2);
        let share = at - index as f64;
        let (from, to) = (&self.positions[index], &self.positions[index + 1]);
        [0, 1, 2].map(|i| from[i] + share * (to[i] - from[i]))
    }

    /// Planet-fixed direction from the satellite to a position.
    pub(super) fn heading(&self, position: &Vector3<f64>, seconds: f64) -> Vector3<f64> {
        let line = sub(position, &self.position(seconds));
        scale(&line, 1.0 / norm(&line))
    }

    /// Sunlight at a time, s.
    pub(super) fn light(&self, seconds: f64) -> &Light {
        let index = (seconds / LIGHT_STEP_S).max(0.0) as usize;
        &self.lights[index.min(self.lights.len() - 1)]
    }
}

fn light(run: &TaskRun, index: usize, args: &SatelliteArgs) -> Light {
    let sky = run.sim.sky();
    let middle = ((index as f64 + 0.5) * LIGHT_STEP_S).min(run.sim.time_limit_s());
    let position = run.sim.satellite(0).orbit().arc(middle).position(middle);
    let sun = sky.sun(middle);
    let to_sun = sub(&sun, &position);
    let distance = norm(&to_sun);
    Light {
        sun: rotate(&sky.earth(middle).planet_from_inertial(), &scale(&to_sun, 1.0 / distance)),
        panel_w: args.facing_panel_w(distance) * illumination(&position, &sun),
        dark_s: 0.0,
    }
}
