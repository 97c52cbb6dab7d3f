//! Conjunction warnings, as an operator gets them: which debris will pass which satellite, when, how near, how fast, and
//! with what probability of a collision.
//!
//! Both bodies are foreseen by the episode's own dynamics under hold, so an exact warning comes true to the bit if nobody
//! burns. Within a step bodies move on straight lines (`p += v` is all the motion of a step), so a closest approach has
//! a closed form. What no forecast knows is left out: rogues yet to come, fragments, and what passed before.

use serde::{Deserialize, Serialize};

use super::constants::{EARTH_RADIUS_2, SATELLITES};
use super::flight::{Flight, Satellite};
use super::kernel::{Body, collision_probability, passing_2};
use super::setup::{Physics, Warnings};
use crate::chance::{Chance, Stream};

/// Steps of 1 TU that are foreseen.
pub const LOOK_AHEAD: usize = 15;
/// Closest approaches farther than this, LU, are no conjunctions. It is the true miss that counts, whether or not the
/// warning errs, so that noise changes what warnings say and not which there are.
pub const SCREENING: f64 = 6.0;
/// Standard deviation, in units of `sigma`, by which a noisy warning errs on each axis of the relative position at the
/// full look-ahead; it grows from zero in proportion to the time to closest approach.
pub const NOISE_GROWTH: f64 = 4.0;

/// One warning.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Conjunction {
    /// Whom it warns: 0 to 2.
    pub satellite_id: u32,
    /// Of what.
    pub debris_id: u32,
    /// Time from now, TU, 0 to 15.
    pub time_to_closest_approach: f64,
    /// Distance then, LU.
    pub miss_distance: f64,
    /// Speed of one as seen from the other then, LU/TU.
    pub relative_speed: f64,
    /// Probability that they pass nearer than contact distance.
    pub probability: f64,
}

/// A closest approach to come.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Approach {
    /// TU from now.
    time: f64,
    /// The satellite as seen from the debris then, LU.
    miss: (f64, f64),
    /// Its velocity as seen from there, LU/TU.
    velocity: (f64, f64),
}

impl<C: Chance> Flight<C> {
    /// What the option `warnings` asks for; `None` where it asks for none. With `all`, of hidden debris too. Ordered by
    /// satellite, then time, then debris. Of one pair only the deepest approach within the look-ahead is told.
    #[must_use]
    pub fn conjunctions(&self, all: bool) -> Option<Vec<Conjunction>> {
        let asked = self.setup().warnings != Warnings::None;
        asked.then(|| self.foreseen(all))
    }

    /// The same whether or not they are asked for; with the option's errors, exact where there is none.
    #[must_use]
    pub fn foreseen(&self, all: bool) -> Vec<Conjunction> {
        let noisy = self.setup().warnings == Warnings::Noisy;
        let physics = self.setup().physics;
        let paths = self.satellites().each_ref().map(|s| Path::under_hold(s, physics));
        let debris = self.debris();
        let mut found = Vec::new();
        for (i, body) in debris.bodies().enumerate().filter(|(_, body)| all || self.sees(body.x, body.y)) {
            let approaches = approaches(body, &paths, physics);
            for (satellite, approach) in (0u32..).zip(approaches) {
                if let Some(approach) = approach {
                    found.push(self.warn(satellite, debris.id(i), approach, noisy));
                }
            }
        }
        found.sort_unstable_by(|a: &Conjunction, b| {
            let times = a.time_to_closest_approach.total_cmp(&b.time_to_closest_approach);
            a.satellite_id.cmp(&b.satellite_id).then(times).then(a.debris_id.cmp(&b.debris_id))
        });
        found
    }

    fn warn(&self, satellite: u32, debris: u32, mut approach: Approach, noisy: bool) -> Conjunction {
        let mut sigma = self.setup().sigma;
        if noisy {
            let error = noise(sigma, approach.time);
            let stream = Stream::Warning { step: self.steps(), satellite, debris };
            approach = approach.mistaken(error, self.chance().first_normals(stream));
            sigma = (sigma * sigma + error * error).sqrt();
        }
        let miss = length(approach.miss);
        Conjunction {
            satellite_id: satellite,
            debris_id: debris,
            time_to_closest_approach: approach.time,
            miss_distance: miss,
            relative_speed: length(approach.velocity),
            probability: collision_probability(miss, sigma),
        }
    }
}

/// Standard deviation, LU, of a noisy warning's error on each axis, so many TU before the closest approach.
pub(super) fn noise(sigma: f64, time: f64) -> f64 {
    sigma * NOISE_GROWTH * time / LOOK_AHEAD as f64
}

fn length((x, y): (f64, f64)) -> f64 {
    (x * x + y * y).sqrt()
}

impl Approach {
    /// The approach as it looks if the relative position is mistaken by `error` times two normal draws: what lies
    /// across the relative velocity changes the miss, what lies along it the time.
    fn mistaken(mut self, error: f64, normals: (f64, f64)) -> Self {
        let (nx, ny) = (error * normals.0, error * normals.1);
        let (wx, wy) = self.velocity;
        let late = (nx * wx + ny * wy) / (wx * wx + wy * wy).max(f64::MIN_POSITIVE);
        self.time = (self.time - late).clamp(0.0, LOOK_AHEAD as f64);
        self.miss.0 += nx - wx * late;
        self.miss.1 += ny - wy * late;
        self
    }
}

/// Where a satellite will be under hold.
struct Path {
    bodies: [Body; LOOK_AHEAD + 1],
    /// Steps it will fly: fewer than the look-ahead if it falls into the Earth, none if it is lost.
    steps: usize,
}

impl Path {
    fn under_hold(satellite: &Satellite, physics: Physics) -> Self {
        let mut path = Self { bodies: [satellite.body; LOOK_AHEAD + 1], steps: 0 };
        if satellite.active() {
            while path.steps < LOOK_AHEAD && path.bodies[path.steps].radius_2() >= EARTH_RADIUS_2 {
                path.bodies[path.steps + 1] = path.bodies[path.steps].coasted(physics.gravity);
                path.steps += 1;
            }
        }
        path
    }
}

/// Where debris is after one more step, if it is still there; its velocity is that of this step.
pub(super) fn debris_moved(body: Body, physics: Physics) -> Option<Body> {
    if body.radius_2() >= EARTH_RADIUS_2 {
        Some(body.coasted(physics.gravity))
    } else {
        // The public original leaves what is inside the Earth where it is.
        physics.upstream.then_some(Body { vx: 0.0, vy: 0.0, ..body })
    }
}

/// Per satellite, the deepest closest approach of this debris.
fn approaches(
    mut body: Body,
    paths: &[Path; SATELLITES],
    physics: Physics,
) -> [Option<Approach>; SATELLITES] {
    let mut deepest = [None; SATELLITES];
    let mut nearest = [SCREENING * SCREENING; SATELLITES];
    let mut approaching = paths.each_ref().map(|path| closing(&path.bodies[0], &body));
    for step in 1..=LOOK_AHEAD {
        let Some(moved) = debris_moved(body, physics) else { break };
        body = moved;
        for (i, path) in paths.iter().enumerate().filter(|(_, path)| step <= path.steps) {
            let s = &path.bodies[step];
            let (dx, dy) = (s.x - body.x, s.y - body.y);
            let (wx, wy) = (s.vx - body.vx, s.vy - body.vy);
            let before = std::mem::replace(&mut approaching[i], dx * wx + dy * wy < 0.0);
            if let Some(miss_2) = passing_2(dx, dy, wx, wy, before).filter(|&m| m < nearest[i]) {
                nearest[i] = miss_2;
                let back = time_back(dx, dy, wx, wy);
                deepest[i] = Some(Approach {
                    time: step as f64 - back,
                    miss: (dx - wx * back, dy - wy * back),
                    velocity: (wx, wy),
                });
            }
        }
    }
    deepest
}

fn closing(s: &Body, d: &Body) -> bool {
    (s.x - d.x) * (s.vx - d.vx) + (s.y - d.y) * (s.vy - d.vy) < 0.0
}

/// How long before the end of a step, 0 to 1 TU, two bodies were nearest: relative position `d` and velocity `w` at its
/// end. Where nothing moves any time will do.
#[inline(always)]
pub(super) fn time_back(dx: f64, dy: f64, wx: f64, wy: f64) -> f64 {
    ((dx * wx + dy * wy) / (wx * wx + wy * wy).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0)
}
