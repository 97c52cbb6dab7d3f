//! Satellite 0's way to radius 100 LU. Half a Hohmann ellipse takes 65–85 TU, longer than the horizon, so the planner
//! starts from fast radial transfers: an opening kick spread over the first steps, a coast, and a feedback that arrives
//! and stays. Its few gains are searched at random and then around the best (random search with shrinking spread).

use super::panel::capped;
use super::table::{Path, Table};
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::constants::{
    FUEL_PER_SPEED, GM, GOAL, HORIZON, MAX_BURN, RENDEZVOUS_STEPS, TARGET_RADIUS,
};
use crate::kessler::kernel::Body;
use crate::kessler::reward::proximity;

const GAINS: usize = 7;
/// Bounds of the gains, in order: opening kick radial and in-track (LU/TU), the radius at which feedback begins (LU),
/// desired radial speed per LU of error (1/TU), weight of the in-track correction, smallest burn worth making (LU/TU),
/// and the fastest climb the feedback asks for (LU/TU).
const BOUNDS: [(f64, f64); GAINS] =
    [(0.0, 4.5), (-0.3, 1.5), (70.0, 101.0), (0.1, 1.0), (0.0, 1.0), (0.0, 0.25), (0.5, 4.5)];
const RANDOM: u32 = 260;
const LOCAL: u32 = 260;
const DODGES: u32 = 400;

/// The best transfer found from satellite 0's start, for as long as it is `wanted`.
pub(super) fn search(
    table: &Table,
    body: Body,
    fuel: f64,
    hold: &Path,
    chance: &mut Seeded,
    wanted: &dyn Fn() -> bool,
) -> Path {
    let mut path = Path::start(body, fuel);
    let mut best = hold.clone();
    let mut best_worth = worth(hold);
    let mut best_gains = BOUNDS.map(|(low, high)| 0.5 * (low + high));
    for trial in 0..RANDOM + LOCAL {
        if !wanted() {
            return best;
        }
        let gains = if trial < RANDOM {
            BOUNDS.map(|(low, high)| chance.between(Stream::Planner, low, high))
        } else {
            let spread = 0.25 * (1.0 - f64::from(trial - RANDOM) / f64::from(LOCAL)) + 0.01;
            around(best_gains, spread, chance)
        };
        path.branch(hold, 1);
        steer(table, &mut path, 1, &gains, None);
        let value = worth(&path);
        if value > best_worth {
            (best_worth, best_gains) = (value, gains);
            best.clone_from(&path);
        }
    }
    if best.lost() {
        dodge(table, hold, &mut best, best_worth, best_gains, chance, wanted);
    }
    best
}

/// The same transfer with one sidestep somewhere, where every transfer met something.
fn dodge(
    table: &Table,
    hold: &Path,
    best: &mut Path,
    mut best_worth: f64,
    gains: [f64; GAINS],
    chance: &mut Seeded,
    wanted: &dyn Fn() -> bool,
) {
    let mut path = hold.clone();
    for _ in 0..DODGES {
        if !wanted() {
            return;
        }
        let step = 1 + (chance.uniform(Stream::Planner) * f64::from(best.survived() + 1).min(49.0)) as u32;
        let size = chance.uniform(Stream::Planner);
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * chance.uniform(Stream::Planner));
        let gains = around(gains, 0.3, chance);
        path.branch(hold, 1);
        steer(table, &mut path, 1, &gains, Some((step, size * cos, size * sin)));
        if worth(&path) > best_worth {
            best_worth = worth(&path);
            best.clone_from(&path);
        }
        if !best.lost() && goal(best) >= GOAL {
            return;
        }
    }
}

fn around(gains: [f64; GAINS], spread: f64, chance: &mut Seeded) -> [f64; GAINS] {
    let mut near = gains;
    for (gain, (low, high)) in near.iter_mut().zip(BOUNDS) {
        // The sum of three uniform draws: bell-shaped enough, and no transcendental function.
        let bell: f64 = (0..3).map(|_| chance.between(Stream::Planner, -1.0, 1.0)).sum();
        *gain = (*gain + spread * (high - low) * bell).clamp(low, high);
    }
    near
}

/// Steps of reward that satellite 0's path earns, twice over (so that they are whole without proximity), and a bonus
/// for what makes an episode a success.
fn worth(path: &Path) -> f64 {
    let near: f64 = path.weights().map(|(t, weight)| proximity(path.bodies[t].radius()) * weight).sum();
    let survived: f64 = path.weights().map(|(_, weight)| weight).sum();
    let success = !path.lost() && goal(path) >= GOAL;
    survived / 3.0 + near + if success { 20.0 } else { 0.0 }
}

/// Mean proximity over the last steps.
fn goal(path: &Path) -> f64 {
    let first = (HORIZON - RENDEZVOUS_STEPS) as usize + 1;
    let late = path.weights().filter(|(t, _)| *t >= first);
    late.map(|(t, weight)| proximity(path.bodies[t].radius()) * weight).sum::<f64>()
        / f64::from(RENDEZVOUS_STEPS)
}

/// Flies the gains from `step` on, with an optional sidestep.
fn steer(table: &Table, path: &mut Path, step: u32, gains: &[f64; GAINS], sidestep: Option<(u32, f64, f64)>) {
    let [mut radial, mut in_track, begin, gain, weight, deadband, climb] = *gains;
    for t in step..=HORIZON {
        let body = path.bodies[t as usize - 1];
        let fuel = path.fuel[t as usize - 1];
        let ((rx, ry), (tx, ty)) = body.frame();
        let (mut dr, mut dt) = (0.0, 0.0);
        if radial > 0.0 || in_track.abs() > 1e-9 {
            let size = (radial * radial + in_track * in_track).sqrt();
            let part = (MAX_BURN / size).min(1.0);
            (dr, dt) = (radial * part, in_track * part);
            radial -= dr;
            in_track -= dt;
            if part >= 1.0 {
                (radial, in_track) = (0.0, 0.0);
            }
        } else {
            let r = body.radius();
            if r >= begin {
                (dr, dt) = feedback(&body, r, gain, weight, climb);
                if (dr * dr + dt * dt).sqrt() < deadband {
                    (dr, dt) = (0.0, 0.0);
                }
            }
        }
        let (mut dvx, mut dvy) = (dr * rx + dt * tx, dr * ry + dt * ty);
        if let Some((at, sx, sy)) = sidestep
            && at == t
        {
            dvx += sx;
            dvy += sy;
        }
        if !path.advance(table, t, affordable(dvx, dvy, fuel)) {
            return;
        }
    }
}

/// The change of speed, radial and in-track, that arrives at the target radius and stays there on a circular orbit.
pub(in crate::kessler) fn feedback(body: &Body, r: f64, gain: f64, weight: f64, climb: f64) -> (f64, f64) {
    let ((rx, ry), (tx, ty)) = body.frame();
    let vr = body.vx * rx + body.vy * ry;
    let vt = body.vx * tx + body.vy * ty;
    let wanted = (gain * (TARGET_RADIUS - r)).clamp(-climb, climb);
    // Next step's pull, felt before it moves: GM/r² less the centrifugal part.
    let pull = GM / (r * r) - vt * vt / r;
    (wanted - vr + pull, weight * ((GM / r).sqrt() - vt))
}

/// A burn scaled to what one step and the fuel allow; `None` where nothing is left to do or to do it with.
pub(in crate::kessler) fn affordable(dvx: f64, dvy: f64, fuel: f64) -> Option<(f64, f64)> {
    let size = (dvx * dvx + dvy * dvy).sqrt();
    let most = capped(MAX_BURN, fuel);
    if size < 1e-6 || most < 1e-6 * FUEL_PER_SPEED {
        return None;
    }
    let part = (most / size).min(1.0);
    Some((dvx * part, dvy * part))
}
