//! Transfer of satellite 0 to radius 100 LU. Half a Hohmann ellipse takes 65–85 TU, longer than the horizon.
//! The planner therefore starts from fast radial transfers: an opening kick spread over the first steps, a
//! coast, and a feedback that arrives at the radius and stays. Its few gains are searched at random and then
//! around the best (random search with shrinking spread).

use super::ephemeris::DebrisEphemeris;
use super::panel::affordable_size;
use super::trajectory::{PlannedBurn, Trajectory};
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::constants::{
    FUEL_PER_SPEED, GM, GOAL_THRESHOLD, HORIZON, MAX_BURN, RENDEZVOUS_STEPS, SATELLITES, TARGET_RADIUS,
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
/// Number of transfers that are propagated side by side: each step of one waits for the step before it.
const SIDE_BY_SIDE: usize = 4;
/// Bonus for a trajectory that makes the episode a success.
const SUCCESS_BONUS: f64 = 20.0;
/// Number of satellites among which the team's reward for survival is divided, which gives the worth of a step survived.
const TEAM: f64 = SATELLITES as f64;
/// Allowance for the rounding of a worth that is summed up in another order.
const ROUNDING: f64 = 1e-9;

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
    ephemeris.prepare_search();
    let mut trajectories: [Trajectory; SIDE_BY_SIDE] = std::array::from_fn(|_| Trajectory::new(body, fuel));
    let mut best = hold.clone();
    let mut best_worth = worth(hold);
    let mut best_gains = GAIN_BOUNDS.map(|(low, high)| 0.5 * (low + high));
    for first in (0..RANDOM_TRANSFERS + LOCAL_TRANSFERS).step_by(SIDE_BY_SIDE) {
        if !is_wanted() {
            return best;
        }
        let trials: [TransferTrial; SIDE_BY_SIDE] =
            std::array::from_fn(|lane| TransferTrial::draw(first + lane as u32, rng));
        let mut next = 0;
        while next < SIDE_BY_SIDE {
            let first = next;
            let gains = trials.each_ref().map(|trial| trial.gains(best_gains));
            let start = TransferStart { ephemeris, hold, best_worth };
            let is_complete = start.steer_side_by_side(&mut trajectories[first..], &gains[first..]);
            for lane in first..SIDE_BY_SIDE {
                next = lane + 1;
                let value = if is_complete[lane - first] { worth(&trajectories[lane]) } else { f64::MIN };
                if value > best_worth {
                    (best_worth, best_gains) = (value, gains[lane]);
                    best.clone_from(&trajectories[lane]);
                    if trials[lane].is_local() {
                        break; // The gains of the later trials are near the new best.
                    }
                }
            }
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
        let mut control = TransferControl::new(GainOffsets::draw(0.3, rng).apply(gains));
        control.evasive_burn = Some(PlannedBurn { step, dvx: size * cos, dvy: size * sin });
        let start = TransferStart { ephemeris, hold, best_worth };
        if start.steer(&mut trajectory, control) && worth(&trajectory) > best_worth {
            best_worth = worth(&trajectory);
            best.clone_from(&trajectory);
        }
        if !best.is_lost() && mean_proximity(best) >= GOAL_THRESHOLD {
            return;
        }
    }
}

/// Draws of a trial, from which its gains follow once the best ones before it are known.
enum TransferTrial {
    /// Gains that are drawn at random.
    Random(TransferGains),
    /// Gains near the best.
    Local(GainOffsets),
}

impl TransferTrial {
    fn draw(number: u32, rng: &mut SeededRng) -> Self {
        if number < RANDOM_TRANSFERS {
            Self::Random(GAIN_BOUNDS.map(|(low, high)| rng.uniform_in(RngStream::Planner, low, high)))
        } else {
            let progress = f64::from(number - RANDOM_TRANSFERS) / f64::from(LOCAL_TRANSFERS);
            Self::Local(GainOffsets::draw(0.25 * (1.0 - progress) + 0.01, rng))
        }
    }

    fn gains(&self, best: TransferGains) -> TransferGains {
        match self {
            Self::Random(gains) => *gains,
            Self::Local(offsets) => offsets.apply(best),
        }
    }

    const fn is_local(&self) -> bool {
        matches!(self, Self::Local(_))
    }
}

/// Random offsets of gains.
struct GainOffsets {
    /// Factor of the offsets, as a share of the range of each gain.
    spread: f64,
    offsets: [f64; GAIN_COUNT],
}

impl GainOffsets {
    fn draw(spread: f64, rng: &mut SeededRng) -> Self {
        // The sum of three uniform draws is bell-shaped enough, and needs no transcendental function.
        let mut bell = || (0..3).map(|_| rng.uniform_in(RngStream::Planner, -1.0, 1.0)).sum();
        Self { spread, offsets: std::array::from_fn(|_| bell()) }
    }

    fn apply(&self, gains: TransferGains) -> TransferGains {
        std::array::from_fn(|i| {
            let (low, high) = GAIN_BOUNDS[i];
            (gains[i] + self.spread * (high - low) * self.offsets[i]).clamp(low, high)
        })
    }
}

/// Contribution of satellite 0's trajectory to the team's reward, in steps and doubled (so that a step of
/// full proximity counts as one), plus a bonus if the episode is a success.
fn worth(trajectory: &Trajectory) -> f64 {
    let proximity_sum: f64 =
        trajectory.survival_weights().map(|(t, weight)| proximity_at(trajectory, t) * weight).sum();
    let survived: f64 = trajectory.survival_weights().map(|(_, weight)| weight).sum();
    let is_success = !trajectory.is_lost() && mean_proximity(trajectory) >= GOAL_THRESHOLD;
    survived / TEAM + proximity_sum + if is_success { SUCCESS_BONUS } else { 0.0 }
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

/// Start of transfers, and what they must exceed.
#[derive(Clone, Copy)]
struct TransferStart<'a> {
    ephemeris: &'a DebrisEphemeris,
    hold: &'a Trajectory,
    /// Worth of the best transfer so far.
    best_worth: f64,
}

impl TransferStart<'_> {
    /// Propagates a transfer for each of these gains. Returns which ones were propagated to their end; the others
    /// cannot exceed the best.
    fn steer_side_by_side(
        self,
        trajectories: &mut [Trajectory],
        gains: &[TransferGains],
    ) -> [bool; SIDE_BY_SIDE] {
        let mut transfers = [None; SIDE_BY_SIDE];
        for ((transfer, trajectory), gains) in transfers.iter_mut().zip(&mut *trajectories).zip(gains) {
            *transfer = Some(ActiveTransfer::new(TransferControl::new(*gains)));
            trajectory.branch_from(self.hold, 1);
        }
        let mut is_complete = [true; SIDE_BY_SIDE];
        for t in 1..=HORIZON {
            for (lane, (transfer, trajectory)) in transfers.iter_mut().zip(&mut *trajectories).enumerate() {
                let Some(active) = transfer else { continue };
                if !active.control.advance(trajectory, self.ephemeris, t) {
                    *transfer = None;
                } else if !active.can_exceed(self.best_worth, trajectory, t) {
                    *transfer = None;
                    is_complete[lane] = false;
                }
            }
        }
        is_complete
    }

    /// Propagates a transfer. Returns false if it ended early because it cannot exceed the best.
    fn steer(self, trajectory: &mut Trajectory, control: TransferControl) -> bool {
        let mut transfer = ActiveTransfer::new(control);
        trajectory.branch_from(self.hold, 1);
        for t in 1..=HORIZON {
            if !transfer.control.advance(trajectory, self.ephemeris, t) {
                return true;
            }
            if !transfer.can_exceed(self.best_worth, trajectory, t) {
                return false;
            }
        }
        true
    }
}

/// A transfer that is propagated, with its worth so far.
#[derive(Clone, Copy)]
struct ActiveTransfer {
    control: TransferControl,
    /// Worth of the steps so far.
    worth: f64,
}

impl ActiveTransfer {
    const fn new(control: TransferControl) -> Self {
        Self { control, worth: 0.0 }
    }

    /// Counts step `t`. Returns false if even full proximity in all later steps and a success would not exceed a worth.
    fn can_exceed(&mut self, best_worth: f64, trajectory: &Trajectory, t: u32) -> bool {
        let weight = trajectory.survival[t as usize];
        self.worth += weight * (1.0 / TEAM + proximity_at(trajectory, t as usize));
        let later = weight * f64::from(HORIZON - t) * (1.0 / TEAM + 1.0);
        self.worth + later + SUCCESS_BONUS > best_worth - ROUNDING
    }
}

/// Control law of a transfer: the rest of its opening kick, then feedback.
#[derive(Clone, Copy)]
struct TransferControl {
    gains: TransferGains,
    /// Rest of the opening kick (radial, in-track), LU/TU.
    kick: (f64, f64),
    evasive_burn: Option<PlannedBurn>,
}

impl TransferControl {
    const fn new(gains: TransferGains) -> Self {
        Self { gains, kick: (gains[0], gains[1]), evasive_burn: None }
    }

    /// Advances a trajectory by step `t`. Returns false once the satellite is lost.
    fn advance(&mut self, trajectory: &mut Trajectory, ephemeris: &DebrisEphemeris, t: u32) -> bool {
        let body = trajectory.bodies[t as usize - 1];
        let fuel = trajectory.fuel[t as usize - 1];
        let ((rx, ry), (tx, ty)) = body.local_axes();
        let (dr, dt) = self.next_kick().unwrap_or_else(|| self.feedback(&body));
        let (mut dvx, mut dvy) = (dr * rx + dt * tx, dr * ry + dt * ty);
        if let Some(burn) = self.evasive_burn.filter(|burn| burn.step == t) {
            dvx += burn.dvx;
            dvy += burn.dvy;
        }
        trajectory.advance(ephemeris, t, affordable_burn(dvx, dvy, fuel))
    }

    /// Part of the opening kick that the next step can burn; `None` once it is spent.
    fn next_kick(&mut self) -> Option<(f64, f64)> {
        let (radial, in_track) = self.kick;
        if radial <= 0.0 && in_track.abs() <= 1e-9 {
            return None;
        }
        let size = (radial * radial + in_track * in_track).sqrt();
        let part = (MAX_BURN / size).min(1.0);
        let burn = (radial * part, in_track * part);
        self.kick = if part >= 1.0 { (0.0, 0.0) } else { (radial - burn.0, in_track - burn.1) };
        Some(burn)
    }

    /// Burn of the feedback, none before its radius is reached.
    fn feedback(&self, body: &Body) -> (f64, f64) {
        let [_, _, feedback_radius, gain, weight, deadband, max_climb] = self.gains;
        let radius = body.radius();
        if radius < feedback_radius {
            return (0.0, 0.0);
        }
        let (dr, dt) = radius_feedback(body, radius, gain, weight, max_climb);
        if (dr * dr + dt * dt).sqrt() < deadband { (0.0, 0.0) } else { (dr, dt) }
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
