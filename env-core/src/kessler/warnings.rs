//! Conjunction warnings as an operator gets them: which debris will pass which satellite, when, at what
//! distance and speed, and with what probability of collision.
//!
//! Both bodies are propagated by the episode's own dynamics under hold, so an exact warning comes true to the
//! bit if no satellite burns. Within a step bodies move on straight lines (`p += v` is all its motion), so a
//! closest approach has a closed form. Warnings do not cover rogues yet to come, fragments, and passes that
//! are over.

use serde::{Deserialize, Serialize};

use super::constants::{EARTH_RADIUS_2, SATELLITES};
use super::kernel::{Body, closest_approach_squared, collision_probability};
use super::setup::{Physics, WarningMode};
use super::simulation::{KesslerSim, Satellite};
use crate::episode_rng::{EpisodeRng, RngStream};

/// Steps of 1 TU that warnings look ahead.
pub const WARNING_LOOK_AHEAD: usize = 15;
/// Largest miss distance of a conjunction, LU. The true miss counts even if the warning is noisy, so noise
/// changes the numbers of warnings but not which warnings there are.
pub const SCREENING_DISTANCE: f64 = 6.0;
/// Standard deviation, in units of `sigma`, of the error of a noisy warning on each axis of the relative
/// position at the full look-ahead. The error grows from zero in proportion to the time to closest approach.
pub const NOISE_GROWTH: f64 = 4.0;

/// Warning of one conjunction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Conjunction {
    /// Number of the satellite, 0 to 2.
    pub satellite_id: u32,
    /// Id of the debris.
    pub debris_id: u32,
    /// Time to the closest approach, TU from now, 0 to 15.
    pub time_to_closest_approach: f64,
    /// Distance at the closest approach, LU.
    pub miss_distance: f64,
    /// Relative speed at the closest approach, LU/TU.
    pub relative_speed: f64,
    /// Probability that they pass closer than the contact distance.
    pub probability: f64,
}

impl<R: EpisodeRng> KesslerSim<R> {
    /// Warnings of the option `warnings`, or `None` if the option asks for none. `all` includes hidden
    /// debris. Warnings are ordered by satellite, time and debris. Each pair has at most one warning: its
    /// deepest approach within the look-ahead.
    #[must_use]
    pub fn conjunctions(&self, all: bool) -> Option<Vec<Conjunction>> {
        let enabled = self.setup().warnings != WarningMode::None;
        enabled.then(|| self.forecast_conjunctions(all))
    }

    /// Warnings as in [`KesslerSim::conjunctions`], even if the option asks for none; they are exact then.
    #[must_use]
    pub fn forecast_conjunctions(&self, all: bool) -> Vec<Conjunction> {
        let noisy = self.setup().warnings == WarningMode::Noisy;
        let physics = self.setup().physics;
        let paths = self.satellites().each_ref().map(|s| HoldPath::new(s, physics));
        let debris = self.debris();
        let is_included = |body: &Body| all || self.is_visible(body.x, body.y);
        let mut conjunctions = Vec::new();
        for (i, body) in debris.bodies().enumerate().filter(|(_, body)| is_included(body)) {
            let approaches = deepest_approaches(body, &paths, physics);
            for (satellite, approach) in (0u32..).zip(approaches) {
                if let Some(approach) = approach {
                    conjunctions.push(self.build_warning(satellite, debris.id(i), approach, noisy));
                }
            }
        }
        conjunctions.sort_unstable_by(|a: &Conjunction, b| {
            let times = a.time_to_closest_approach.total_cmp(&b.time_to_closest_approach);
            a.satellite_id.cmp(&b.satellite_id).then(times).then(a.debris_id.cmp(&b.debris_id))
        });
        conjunctions
    }

    fn build_warning(
        &self,
        satellite: u32,
        debris: u32,
        mut approach: ForecastApproach,
        noisy: bool,
    ) -> Conjunction {
        let mut sigma = self.setup().sigma;
        if noisy {
            let error = noise_sigma(sigma, approach.time);
            let stream = RngStream::Warning { step: self.steps(), satellite, debris };
            approach = approach.displaced(error, self.rng().peek_normals(stream));
            sigma = (sigma * sigma + error * error).sqrt();
        }
        let miss = norm(approach.miss.0, approach.miss.1);
        Conjunction {
            satellite_id: satellite,
            debris_id: debris,
            time_to_closest_approach: approach.time,
            miss_distance: miss,
            relative_speed: norm(approach.velocity.0, approach.velocity.1),
            probability: collision_probability(miss, sigma),
        }
    }
}

/// Standard deviation, LU, of a noisy warning's error on each axis, `time` TU before the closest approach.
fn noise_sigma(sigma: f64, time: f64) -> f64 {
    sigma * NOISE_GROWTH * time / WARNING_LOOK_AHEAD as f64
}

fn norm(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// Closest approach to come.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ForecastApproach {
    /// Time of the approach, TU from now.
    time: f64,
    /// Position of the satellite relative to the debris at that time, LU.
    miss: (f64, f64),
    /// Velocity of the satellite relative to the debris at that time, LU/TU.
    velocity: (f64, f64),
}

impl ForecastApproach {
    /// Returns the approach with its relative position displaced by `error` times two normal draws. A
    /// displacement across the relative velocity changes the miss, one along it the time.
    fn displaced(mut self, error: f64, normals: [f64; 2]) -> Self {
        let (nx, ny) = (error * normals[0], error * normals[1]);
        let (wx, wy) = self.velocity;
        let delay = (nx * wx + ny * wy) / (wx * wx + wy * wy).max(f64::MIN_POSITIVE);
        self.time = (self.time - delay).clamp(0.0, WARNING_LOOK_AHEAD as f64);
        self.miss.0 += nx - wx * delay;
        self.miss.1 += ny - wy * delay;
        self
    }
}

/// Path of a satellite under hold.
struct HoldPath {
    bodies: [Body; WARNING_LOOK_AHEAD + 1],
    /// Steps that the satellite flies: fewer than the look-ahead if it falls into the Earth, none if it is
    /// lost.
    steps: usize,
}

impl HoldPath {
    fn new(satellite: &Satellite, physics: Physics) -> Self {
        let mut path = Self { bodies: [satellite.body; WARNING_LOOK_AHEAD + 1], steps: 0 };
        if satellite.is_active() {
            while path.steps < WARNING_LOOK_AHEAD
                && path.bodies[path.steps].radius_squared() >= EARTH_RADIUS_2
            {
                path.bodies[path.steps + 1] = path.bodies[path.steps].coast(physics.gravity);
                path.steps += 1;
            }
        }
        path
    }
}

/// Returns the debris after one more step, or `None` if it fell into the Earth. Its velocity is that of this
/// step.
pub(super) fn propagate_debris(body: Body, physics: Physics) -> Option<Body> {
    if body.radius_squared() >= EARTH_RADIUS_2 {
        Some(body.coast(physics.gravity))
    } else {
        // The public kessler-env leaves debris inside the Earth where it is.
        physics.upstream_compat.then_some(Body { vx: 0.0, vy: 0.0, ..body })
    }
}

/// Deepest closest approach of one debris body to each satellite, if it is within the screening distance.
fn deepest_approaches(
    mut body: Body,
    paths: &[HoldPath; SATELLITES],
    physics: Physics,
) -> [Option<ForecastApproach>; SATELLITES] {
    let mut deepest = [None; SATELLITES];
    let mut least_miss_2 = [SCREENING_DISTANCE * SCREENING_DISTANCE; SATELLITES];
    let mut approaching = paths.each_ref().map(|path| are_approaching(&path.bodies[0], &body));
    for step in 1..=WARNING_LOOK_AHEAD {
        let Some(moved) = propagate_debris(body, physics) else { break };
        body = moved;
        for (i, path) in paths.iter().enumerate().filter(|(_, path)| step <= path.steps) {
            let s = &path.bodies[step];
            let (dx, dy) = (s.x - body.x, s.y - body.y);
            let (wx, wy) = (s.vx - body.vx, s.vy - body.vy);
            let before = std::mem::replace(&mut approaching[i], dx * wx + dy * wy < 0.0);
            let miss_2 = closest_approach_squared(dx, dy, wx, wy, before);
            if let Some(miss_2) = miss_2.filter(|&m| m < least_miss_2[i]) {
                least_miss_2[i] = miss_2;
                let back = time_since_closest(dx, dy, wx, wy);
                deepest[i] = Some(ForecastApproach {
                    time: step as f64 - back,
                    miss: (dx - wx * back, dy - wy * back),
                    velocity: (wx, wy),
                });
            }
        }
    }
    deepest
}

fn are_approaching(s: &Body, d: &Body) -> bool {
    (s.x - d.x) * (s.vx - d.vx) + (s.y - d.y) * (s.vy - d.vy) < 0.0
}

/// Time from the closest approach to the end of a step, 0 to 1 TU, for the relative position `dx`, `dy` and
/// velocity `wx`, `wy` at its end. Any value will do if nothing moves.
#[inline(always)]
fn time_since_closest(dx: f64, dy: f64, wx: f64, wy: f64) -> f64 {
    ((dx * wx + dy * wy) / (wx * wx + wy * wy).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
}
