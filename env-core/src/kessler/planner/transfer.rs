//! Transfer of satellite 0 to radius 100 LU. Half a Hohmann ellipse takes 65–85 TU, longer than the horizon.
//! The planner therefore starts from fast radial transfers: an opening kick spread over the first steps, a
//! coast, and a feedback that arrives at the radius and stays. Its few gains are searched at random and then
//! around the best (random search with shrinking spread).

use super::ephemeris::DebrisEphemeris;
use super::panel::affordable_size;
use super::trajectory::{PlannedBurn, Trajectory};
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::constants::{
    FUEL_PER_SPEED, GM, GOAL_THRESHOLD, HORIZON, MAX_BURN, RENDEZVOUS_STEPS, TARGET_RADIUS,
};
use crate::kessler::kernel::Body;
use crate::kessler::reward::proximity;

/// Number of gains of a transfer.
const GAIN_COUNT: usize = 7;
/// Gains of a transfer, in the order of [`GAIN_BOUNDS`].
type TransferGains = [f64; GAIN_COUNT];
/// Bounds of the gains, in order: opening kick radial and in-track (LU/TU), the radius at which feedback
/// begins (LU), desired radial speed per LU of error (1/TU), weight of the in-track correction, smallest burn
/// worth making (LU/TU), and the fastest climb the feedback asks for (LU/TU).
const GAIN_BOUNDS: [(f64, f64); GAIN_COUNT] =
    [(0.0, 4.5), (-0.3, 1.5), (70.0, 101.0), (0.1, 1.0), (0.0, 1.0), (0.0, 0.25), (0.5, 4.5)];
/// Number of trials with random gains.
const RANDOM_TRANSFERS: u32 = 260;
/// Number of trials with gains near the best.
const LOCAL_TRANSFERS: u32 = 260;
/// Number of trials with an evasive burn if every transfer is lost.
const EVASIVE_TRANSFERS: u32 = 400;
/// Bonus for a trajectory that makes the episode a success.
const SUCCESS_BONUS: f64 = 20.0;

/// Returns the best transfer found from satellite 0's start. The search ends early once `is_wanted` returns
/// false.
pub(super) fn search(
    ephemeris: &DebrisEphemeris,
    body: Body,
    fuel: f64,
    hold: &Trajectory,
    rng: &mut SeededRng,
    is_wanted: &dyn Fn() -> bool,
) -> Trajectory {
    let mut trajectory = Trajectory::new(body, fuel);
    let mut best = hold.clone();
    let mut best_worth = worth(hold);
    let mut best_gains = GAIN_BOUNDS.map(|(low, high)| 0.5 * (low + high));
    for trial in 0..RANDOM_TRANSFERS + LOCAL_TRANSFERS {
        if !is_wanted() {
            return best;
        }
        let gains = if trial < RANDOM_TRANSFERS {
            GAIN_BOUNDS.map(|(low, high)| rng.uniform_in(RngStream::Planner, low, high))
        } else {
            let progress = f64::from(trial - RANDOM_TRANSFERS) / f64::from(LOCAL_TRANSFERS);
            perturb(best_gains, 0.25 * (1.0 - progress) + 0.01, rng)
        };
        trajectory.branch_from(hold, 1);
        steer(ephemeris, &mut trajectory, 1, &gains, None);
        let value = worth(&trajectory);
        if value > best_worth {
            (best_worth, best_gains) = (value, gains);
            best.clone_from(&trajectory);
        }
    }
    if best.is_lost() {
        search_evasive(ephemeris, hold, &mut best, best_worth, best_gains, rng, is_wanted);
    }
    best
}

/// Searches transfers with one evasive burn at a random step, after every plain transfer was lost.
fn search_evasive(
    ephemeris: &DebrisEphemeris,
    hold: &Trajectory,
    best: &mut Trajectory,
    mut best_worth: f64,
    gains: TransferGains,
    rng: &mut SeededRng,
    is_wanted: &dyn Fn() -> bool,
) {
    let mut trajectory = hold.clone();
    for _ in 0..EVASIVE_TRANSFERS {
        if !is_wanted() {
            return;
        }
        let window = f64::from(best.steps_survived() + 1).min(49.0);
        let step = 1 + (rng.uniform(RngStream::Planner) * window) as u32;
        let size = rng.uniform(RngStream::Planner);
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * rng.uniform(RngStream::Planner));
        let gains = perturb(gains, 0.3, rng);
        trajectory.branch_from(hold, 1);
        let evasive_burn = PlannedBurn { step, dvx: size * cos, dvy: size * sin };
        steer(ephemeris, &mut trajectory, 1, &gains, Some(evasive_burn));
        if worth(&trajectory) > best_worth {
            best_worth = worth(&trajectory);
            best.clone_from(&trajectory);
        }
        if !best.is_lost() && mean_proximity(best) >= GOAL_THRESHOLD {
            return;
        }
    }
}

fn perturb(gains: TransferGains, spread: f64, rng: &mut SeededRng) -> TransferGains {
    let mut perturbed = gains;
    for (gain, (low, high)) in perturbed.iter_mut().zip(GAIN_BOUNDS) {
        // The sum of three uniform draws is bell-shaped enough, and needs no transcendental function.
        let bell: f64 = (0..3).map(|_| rng.uniform_in(RngStream::Planner, -1.0, 1.0)).sum();
        *gain = (*gain + spread * (high - low) * bell).clamp(low, high);
    }
    perturbed
}

/// Contribution of satellite 0's trajectory to the team's reward, in steps and doubled (so that a step of
/// full proximity counts as one), plus a bonus if the episode is a success.
fn worth(trajectory: &Trajectory) -> f64 {
    let proximity_sum: f64 =
        trajectory.survival_weights().map(|(t, weight)| proximity_at(trajectory, t) * weight).sum();
    let survived: f64 = trajectory.survival_weights().map(|(_, weight)| weight).sum();
    let is_success = !trajectory.is_lost() && mean_proximity(trajectory) >= GOAL_THRESHOLD;
    survived / 3.0 + proximity_sum + if is_success { SUCCESS_BONUS } else { 0.0 }
}

/// Mean proximity over the last steps, which the goal counts.
fn mean_proximity(trajectory: &Trajectory) -> f64 {
    let first = (HORIZON - RENDEZVOUS_STEPS) as usize + 1;
    let last_steps = trajectory.survival_weights().filter(|(t, _)| *t >= first);
    last_steps.map(|(t, weight)| proximity_at(trajectory, t) * weight).sum::<f64>()
        / f64::from(RENDEZVOUS_STEPS)
}

fn proximity_at(trajectory: &Trajectory, t: usize) -> f64 {
    proximity(trajectory.bodies[t].radius())
}

/// Propagates a transfer with these gains from `step` on, with an optional evasive burn.
fn steer(
    ephemeris: &DebrisEphemeris,
    trajectory: &mut Trajectory,
    step: u32,
    gains: &TransferGains,
    evasive_burn: Option<PlannedBurn>,
) {
    let [mut radial, mut in_track, feedback_radius, gain, weight, deadband, max_climb] = *gains;
    for t in step..=HORIZON {
        let body = trajectory.bodies[t as usize - 1];
        let fuel = trajectory.fuel[t as usize - 1];
        let ((rx, ry), (tx, ty)) = body.local_axes();
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
            let radius = body.radius();
            if radius >= feedback_radius {
                (dr, dt) = radius_feedback(&body, radius, gain, weight, max_climb);
                if (dr * dr + dt * dt).sqrt() < deadband {
                    (dr, dt) = (0.0, 0.0);
                }
            }
        }
        let (mut dvx, mut dvy) = (dr * rx + dt * tx, dr * ry + dt * ty);
        if let Some(burn) = evasive_burn
            && burn.step == t
        {
            dvx += burn.dvx;
            dvy += burn.dvy;
        }
        if !trajectory.advance(ephemeris, t, affordable_burn(dvx, dvy, fuel)) {
            return;
        }
    }
}

/// Burn (radial, in-track), LU/TU, of a feedback that arrives at the target radius and stays there on a
/// circular orbit.
pub(in crate::kessler) fn radius_feedback(
    body: &Body,
    r: f64,
    gain: f64,
    weight: f64,
    max_climb: f64,
) -> (f64, f64) {
    let ((rx, ry), (tx, ty)) = body.local_axes();
    let vr = body.vx * rx + body.vy * ry;
    let vt = body.vx * tx + body.vy * ty;
    let desired = (gain * (TARGET_RADIUS - r)).clamp(-max_climb, max_climb);
    // Radial acceleration of the next step, which acts before the motion: GM/r² less the centrifugal part.
    let pull = GM / (r * r) - vt * vt / r;
    (desired - vr + pull, weight * ((GM / r).sqrt() - vt))
}

/// Scales a burn (dvx, dvy) to what one step and the fuel allow. Returns `None` if the burn or the fuel is
/// negligible.
pub(in crate::kessler) fn affordable_burn(dvx: f64, dvy: f64, fuel: f64) -> Option<(f64, f64)> {
    let size = (dvx * dvx + dvy * dvy).sqrt();
    let max_size = affordable_size(MAX_BURN, fuel);
    if size < 1e-6 || max_size < 1e-6 * FUEL_PER_SPEED {
        return None;
    }
    let part = (max_size / size).min(1.0);
    Some((dvx * part, dvy * part))
}
