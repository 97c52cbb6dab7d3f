//! The built-in learner's policy: a reflex with a dozen numbers, and nothing that searches.
//!
//! For each satellite it predicts the closest approach of every visible debris under hold, and at the first that comes
//! nearer than a threshold, soon enough, burns in a direction given by a 2×2 map of where the debris will pass. Which
//! look-ahead, threshold, wait, size and map are good is what it has to learn. For rendezvous the gains of the transfer
//! are learnt too.

use super::Pilot;
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::kernel::Body;
use crate::kessler::planner::table::Table;
use crate::kessler::planner::transfer::{affordable, feedback};
use crate::kessler::telemetry::{SatelliteTelemetry, Telemetry};
use crate::log::ActionLog;
use crate::seed::Seed;

/// How many numbers the policy has.
pub const PARAMETERS: usize = 12;

/// The policy's numbers, each in [0, 1]; what they mean is in [`Parameters::NAMES`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters(pub [f64; PARAMETERS]);

impl Parameters {
    /// What the numbers are, in order. The first eight serve every task, the last four the transfer of rendezvous.
    pub const NAMES: [&str; PARAMETERS] = [
        "look_ahead",
        "miss_threshold",
        "wait",
        "burn_size",
        "map_radial_radial",
        "map_radial_in_track",
        "map_in_track_radial",
        "map_in_track_in_track",
        "transfer_gain",
        "transfer_circularise",
        "transfer_climb",
        "transfer_deadband",
    ];

    /// Uniform random numbers: what the learner starts from, and what `frozen` stays at.
    #[must_use]
    pub fn random(seed: Seed) -> Self {
        let mut chance = Seeded::new(seed);
        Self([(); PARAMETERS].map(|()| chance.uniform(Stream::Policy)))
    }

    fn read(&self) -> Gains {
        let p = self.0.map(|v| v.clamp(0.0, 1.0));
        let within = |i: usize, low: f64, high: f64| low + (high - low) * p[i];
        // Sizes from 0.02 to 1 LU/TU, evenly by ratio: 0.02·50^p by repeated square roots would be exact, libm's pow is.
        Gains {
            look_ahead: within(0, 1.0, 25.0) as u32,
            threshold: within(1, 1.0, 6.0),
            wait: within(2, 1.0, 25.0) as u32,
            size: 0.02 * libm::pow(50.0, p[3]),
            map: [within(4, -1.0, 1.0), within(5, -1.0, 1.0), within(6, -1.0, 1.0), within(7, -1.0, 1.0)],
            gain: within(8, 0.0, 1.0),
            circularise: within(9, 0.0, 1.0),
            climb: within(10, 0.2, 4.5),
            deadband: within(11, 0.0, 0.3),
        }
    }
}

struct Gains {
    look_ahead: u32,
    threshold: f64,
    wait: u32,
    size: f64,
    map: [f64; 4],
    gain: f64,
    circularise: f64,
    climb: f64,
    deadband: f64,
}

pub(super) struct Learner(Gains);

impl Learner {
    pub(super) fn new(parameters: Parameters) -> Self {
        Self(parameters.read())
    }

    /// The burn that dodges the first close approach ahead, if there is one.
    fn dodge(&self, satellite: &Body, ahead: &Table) -> Option<(f64, f64)> {
        let gains = &self.0;
        let mut nearest = vec![(f64::INFINITY, 0u32, (0.0, 0.0)); ahead.len()];
        let mut body = *satellite;
        for step in 1..=gains.look_ahead {
            body = body.coasted();
            for (column, near) in nearest.iter_mut().enumerate() {
                let d2 = ahead.clear_of(column, step as usize, body.x, body.y);
                if d2 < near.0 {
                    let (x, y) = ahead.place(column, step as usize);
                    *near = (d2, step, (x - body.x, y - body.y));
                }
            }
        }
        let limit = gains.threshold * gains.threshold;
        let (d2, _, miss) = *nearest
            .iter()
            .filter(|(d2, step, _)| *d2 < limit && *step <= gains.wait)
            .min_by_key(|(_, step, _)| *step)?;
        let distance = d2.sqrt().max(1e-9);
        let ((rx, ry), (tx, ty)) = satellite.frame();
        let radial = (miss.0 * rx + miss.1 * ry) / distance;
        let in_track = (miss.0 * tx + miss.1 * ty) / distance;
        let [rr, rt, tr, tt] = gains.map;
        let (dr, dt) = (rr * radial + rt * in_track, tr * radial + tt * in_track);
        let length = (dr * dr + dt * dt).sqrt().max(1e-9);
        let (dr, dt) = (gains.size * dr / length, gains.size * dt / length);
        Some((dr * rx + dt * tx, dr * ry + dt * ty))
    }

    fn transfer(&self, satellite: &Body) -> Option<(f64, f64)> {
        let gains = &self.0;
        let ((rx, ry), (tx, ty)) = satellite.frame();
        let (dr, dt) = feedback(satellite, satellite.radius(), gains.gain, gains.circularise, gains.climb);
        ((dr * dr + dt * dt).sqrt() >= gains.deadband).then_some((dr * rx + dt * tx, dr * ry + dt * ty))
    }
}

impl Pilot for Learner {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        let debris: Vec<Body> = seen.radar_debris.iter().map(|d| d.body()).collect();
        let ahead = Table::propagate(&debris, &[], self.0.look_ahead, false);
        for s in seen.satellites.iter().filter(|s| s.active()) {
            let wanted = self.dodge(&s.body(), &ahead).or_else(|| {
                (s.id == 0 && seen.target_radius > 0.0).then(|| self.transfer(&s.body())).flatten()
            });
            burn(s, wanted, log);
        }
    }
}

/// Writes a burn down, scaled to what one step and the fuel allow.
pub(super) fn burn(satellite: &SatelliteTelemetry, wanted: Option<(f64, f64)>, log: &mut ActionLog) {
    if let Some((dvx, dvy)) = wanted.and_then(|(x, y)| affordable(x, y, satellite.fuel)) {
        log.act(satellite.id, &[dvx, dvy]);
    }
}
