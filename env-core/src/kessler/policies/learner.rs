//! The built-in learner's policy: a reflex with a dozen numbers, and nothing that searches.
//!
//! For each satellite it predicts the first visible debris that would come nearer than a threshold under hold, and once
//! that is soon enough burns in a direction given by a 2×2 map of where the debris will pass. Which look-ahead,
//! threshold, wait, size and map are good is what it has to learn. For rendezvous the gains of the transfer are learnt
//! too, for formation those of keeping the shape.

use std::collections::VecDeque;

use crate::kessler::cloud::ABSENT;
use crate::kessler::constants::{EARTH_RADIUS_2, HORIZON, SATELLITES};
use crate::kessler::kernel::{Body, Gravity, distance_2};
use crate::kessler::planner::formation::{Keeping, keep};
use crate::kessler::planner::transfer::{affordable, feedback};
use crate::kessler::telemetry::{DebrisTelemetry, SatelliteTelemetry, Telemetry};
use crate::log::ActionLog;
use crate::policy::Pilot;
use crate::reflex::{self, Meaning, Reflex};
use crate::seed::Seed;

/// The reflex as data.
pub const REFLEX: Reflex = Reflex {
    names: &Parameters::NAMES,
    policy: |numbers| super::learner(Parameters::of(numbers)),
    meaning: |numbers| {
        let meaning = Parameters::of(numbers).meaning();
        meaning.map(|(name, value, unit)| Meaning { name, value, unit }).to_vec()
    },
};

/// How many numbers the policy has.
pub const PARAMETERS: usize = 12;

/// The policy's numbers, each in [0, 1]; what they mean is in [`Parameters::NAMES`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters(pub [f64; PARAMETERS]);

impl Parameters {
    /// What the numbers are, in order. The first eight serve every task, the last four the transfer of
    /// rendezvous; formation takes them as its own gains: gain, steps foreseen, nothing, tolerance.
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

    /// These numbers; missing ones are ½.
    #[must_use]
    pub fn of(numbers: &[f64]) -> Self {
        Self(reflex::numbers(numbers))
    }

    /// Uniform random numbers: what the learner starts from, and what `frozen` stays at.
    #[must_use]
    pub fn random(seed: Seed) -> Self {
        Self(reflex::random(seed))
    }

    /// What the numbers stand for: name, value and unit, in order.
    #[must_use]
    pub fn meaning(&self) -> [(&'static str, f64, &'static str); PARAMETERS] {
        let g = self.read();
        let [rr, rt, tr, tt] = g.map;
        let values = [
            (g.look_ahead as f64, "steps"),
            (g.threshold, "LU"),
            (g.wait as f64, "steps"),
            (g.size, "LU/TU"),
            (rr, ""),
            (rt, ""),
            (tr, ""),
            (tt, ""),
            (g.gain, "1/TU"),
            (g.circularise, ""),
            (g.climb, "LU/TU"),
            (g.deadband, "LU/TU"),
        ];
        std::array::from_fn(|i| (Self::NAMES[i], values[i].0, values[i].1))
    }

    fn read(&self) -> Gains {
        let p = self.0.map(|v| v.clamp(0.0, 1.0));
        let within = |i: usize, low: f64, high: f64| low + (high - low) * p[i];
        // Sizes from 0.02 to 1 LU/TU, evenly by ratio.
        Gains {
            look_ahead: within(0, 1.0, 25.0) as usize,
            threshold: within(1, 1.0, 6.0),
            wait: within(2, 1.0, 25.0) as usize,
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
    /// Steps it predicts.
    look_ahead: usize,
    /// What comes nearer than this, LU, is dodged.
    threshold: f64,
    /// Steps before it comes so near at which it is dodged, and not before.
    wait: usize,
    /// LU/TU.
    size: f64,
    /// From where the debris passes to where the satellite goes, radial and in-track: rr, rt, tr, tt. Only its
    /// direction counts.
    map: [f64; 4],
    /// The last four: see `feedback`.
    gain: f64,
    circularise: f64,
    climb: f64,
    /// Transfer burns below this, LU/TU, are left out.
    deadband: f64,
}

impl Gains {
    /// How a formation is kept, by the same last four numbers.
    fn keeping(&self) -> Keeping {
        // Up to 4 LU are left, and up to 6 steps are foreseen.
        let ahead = 1.0 + 5.0 * self.circularise;
        Keeping { ahead: ahead as u32, gain: self.gain, tolerance: self.deadband / 0.3 * 4.0, until: HORIZON }
    }
}

/// What each satellite burns for the formation; nothing where none is asked for or somebody is lost.
pub(super) fn keeping(seen: &Telemetry, gains: &Keeping) -> Vec<(f64, f64)> {
    let [a, b, c] = seen.satellites.as_slice() else { return Vec::new() };
    if seen.target_separation <= 0.0 || ![a, b, c].iter().all(|s| s.active()) {
        return Vec::new();
    }
    keep(&[a.body(), b.body(), c.body()], gains, Gravity::Point).to_vec()
}

pub(super) struct Learner {
    gains: Gains,
    forecast: Forecast,
    /// Per satellite, where it is after the steps known to be clear under hold, and how many those are.
    clear: [Option<(Body, usize)>; SATELLITES],
}

impl Learner {
    pub(super) fn new(parameters: Parameters) -> Self {
        Self { gains: parameters.read(), forecast: Forecast::default(), clear: [None; SATELLITES] }
    }

    /// The burn that dodges the first close approach ahead, if there is one.
    fn dodge(&mut self, index: usize, satellite: &Body) -> Option<(f64, f64)> {
        let miss = self.approach(index, satellite)?;
        let distance = (miss.0 * miss.0 + miss.1 * miss.1).sqrt().max(1e-9);
        let ((rx, ry), (tx, ty)) = satellite.frame();
        let radial = (miss.0 * rx + miss.1 * ry) / distance;
        let in_track = (miss.0 * tx + miss.1 * ty) / distance;
        let [rr, rt, tr, tt] = self.gains.map;
        let (dr, dt) = (rr * radial + rt * in_track, tr * radial + tt * in_track);
        let length = (dr * dr + dt * dt).sqrt().max(1e-9);
        let (dr, dt) = (self.gains.size * dr / length, self.gains.size * dt / length);
        Some((dr * rx + dt * tx, dr * ry + dt * ty))
    }

    /// Where debris will pass, seen from the satellite, that is the first to come nearer than the threshold.
    fn approach(&mut self, index: usize, satellite: &Body) -> Option<(f64, f64)> {
        let limit = self.gains.threshold * self.gains.threshold;
        let last = self.gains.look_ahead.min(self.gains.wait).min(self.forecast.ahead.len());
        let (mut body, mut step) = self.clear[index].take().unwrap_or((*satellite, 0));
        while step < last {
            let next = body.coasted(Gravity::Point);
            if let Some(column) = self.forecast.ahead[step].nearest(&next, limit) {
                return Some(self.forecast.miss(column, step, next));
            }
            (body, step) = (next, step + 1);
        }
        self.clear[index] = Some((body, step));
        None
    }

    fn transfer(&self, satellite: &Body) -> Option<(f64, f64)> {
        let gains = &self.gains;
        let ((rx, ry), (tx, ty)) = satellite.frame();
        let (dr, dt) = feedback(satellite, satellite.radius(), gains.gain, gains.circularise, gains.climb);
        ((dr * dr + dt * dt).sqrt() >= gains.deadband).then_some((dr * rx + dt * tx, dr * ry + dt * ty))
    }
}

impl Pilot<Telemetry> for Learner {
    fn fly(&mut self, seen: &Telemetry, log: &mut ActionLog) {
        let horizon = self.gains.look_ahead;
        if self.forecast.move_on(&seen.radar_debris, horizon) {
            // One step has passed as foreseen: what was clear is one step nearer.
            for known in &mut self.clear {
                *known = known.take().and_then(|(body, steps)| Some((body, steps.checked_sub(1)?)));
            }
        } else {
            self.clear = [None; SATELLITES];
        }
        let kept = keeping(seen, &self.gains.keeping());
        for (index, s) in seen.satellites.iter().enumerate().take(SATELLITES).filter(|(_, s)| s.active()) {
            let wanted = self.dodge(index, &s.body()).or_else(|| {
                let transferring = s.id == 0 && seen.target_radius > 0.0;
                if transferring { self.transfer(&s.body()) } else { kept.get(index).copied() }
            });
            if wanted.is_some() {
                self.clear[index] = None;
            }
            burn(s, wanted, log);
        }
    }
}

/// Where the visible debris will be. Debris keeps its course whatever satellites do, so one step later the forecast
/// needs one row more, not all of them again.
#[derive(Default)]
struct Forecast {
    ids: Vec<u32>,
    /// One row per step ahead.
    ahead: VecDeque<Row>,
    /// The bodies at the last row.
    end: Vec<Body>,
}

#[derive(Default)]
struct Row {
    x: Vec<f64>,
    y: Vec<f64>,
}

impl Row {
    fn at(&self, column: usize) -> (f64, f64) {
        (self.x[column], self.y[column])
    }

    /// The column nearest to a body, if it is nearer than `limit` (squared).
    fn nearest(&self, body: &Body, limit: f64) -> Option<usize> {
        let (x, y) = (&self.x[..], &self.y[..self.x.len()]);
        let mut any = 0u64;
        for i in 0..x.len() {
            any |= u64::from(distance_2(body.x, body.y, x[i], y[i]) < limit);
        }
        if any == 0 {
            return None;
        }
        let distance = |i: &usize| distance_2(body.x, body.y, x[*i], y[*i]);
        (0..x.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }
}

impl Forecast {
    /// Where `column` will be, seen from a body that is at `body` after `step` rows, when it passes nearest.
    fn miss(&self, column: usize, step: usize, mut body: Body) -> (f64, f64) {
        let mut nearest = ((0.0, 0.0), f64::INFINITY);
        for row in self.ahead.range(step..) {
            let (x, y) = row.at(column);
            let d2 = distance_2(body.x, body.y, x, y);
            if d2 >= nearest.1 {
                break;
            }
            nearest = ((x - body.x, y - body.y), d2);
            body = body.coasted(Gravity::Point);
        }
        nearest.0
    }

    /// Takes what is seen now. True where it is what was foreseen for this step, nothing more and nothing less.
    fn move_on(&mut self, seen: &[DebrisTelemetry], horizon: usize) -> bool {
        let foreseen = self.ahead.front().is_some_and(|row| {
            seen.len() == self.ids.len()
                && seen.iter().enumerate().all(|(i, d)| d.id == self.ids[i] && (d.x, d.y) == row.at(i))
        });
        let row = if foreseen {
            self.ahead.pop_front().unwrap_or_default()
        } else {
            self.ids.clear();
            self.ids.extend(seen.iter().map(|d| d.id));
            self.ahead.clear();
            self.end.clear();
            self.end.extend(seen.iter().map(DebrisTelemetry::body));
            Row::default()
        };
        self.extend(row, horizon);
        foreseen
    }

    fn extend(&mut self, spare: Row, horizon: usize) {
        let mut spare = Some(spare);
        while self.ahead.len() < horizon {
            let mut row = spare.take().unwrap_or_default();
            row.x.clear();
            row.y.clear();
            for body in &mut self.end {
                // Inside the Earth it is gone.
                *body = if body.radius_2() < EARTH_RADIUS_2 { ABSENT } else { body.coasted(Gravity::Point) };
                row.x.push(body.x);
                row.y.push(body.y);
            }
            self.ahead.push_back(row);
        }
    }
}

/// Writes a burn down, scaled to what one step and the fuel allow.
pub(super) fn burn(satellite: &SatelliteTelemetry, wanted: Option<(f64, f64)>, log: &mut ActionLog) {
    if let Some((dvx, dvy)) = wanted.and_then(|(x, y)| affordable(x, y, satellite.fuel)) {
        log.act(satellite.id, &[dvx, dvy]);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::log::Precision;
    use crate::task::StepReport;
    use crate::{Recipe, Scenario, SuccessRule, bracket, rollout};

    /// Looks 20 steps ahead, keeps 2 LU, acts 9 steps before, burns 0.15 LU/TU away from what comes.
    const AWAY: Parameters = Parameters([0.8, 0.22, 0.35, 0.515, 0.0, 0.5, 0.5, 0.0, 0.3, 0.5, 0.5, 0.2]);

    fn contested(task: &str, level: usize) -> impl Iterator<Item = (Scenario, crate::Bracket)> {
        let task = crate::task(task).unwrap();
        let recipe = Arc::new(Recipe::with_params(task, task.levels().params(level)).unwrap());
        (0..).filter_map(move |seed| {
            let scenario = Scenario::new(Arc::clone(&recipe), Seed::user(seed).unwrap());
            let admission = bracket::admit(&scenario);
            admission.bracket.filter(|_| admission.contested).map(|bracket| (scenario, bracket))
        })
    }

    fn share(task: &str, level: usize, parameters: Parameters) -> f64 {
        let n = 60;
        let succeeds = |(scenario, bracket): &(Scenario, crate::Bracket)| {
            let (flown, _) =
                rollout::fly(scenario, &mut *crate::kessler::policies::learner(parameters)).unwrap();
            bracket::success(scenario, SuccessRule::Task, bracket, &flown)
        };
        contested(task, level).take(n).filter(succeeds).count() as f64 / n as f64
    }

    /// There is something to learn, and it can be learnt: the same reflex dodging away or towards.
    #[test]
    fn the_map_decides() {
        for task in ["kessler/survival", "kessler/eco_station"] {
            let mut towards = AWAY;
            (towards.0[4], towards.0[7]) = (1.0, 1.0);
            let (away, towards) = (share(task, 4, AWAY), share(task, 4, towards));
            assert!(away > 0.9 && towards < away - 0.3, "{task}: away {away}, towards {towards}");
        }
    }

    /// What it remembers is only what it would work out again: one that forgets everything after every step does the
    /// same.
    #[test]
    fn memory_moves_nothing() {
        for (task, level) in [("kessler/survival", 5), ("kessler/eco_station", 7), ("kessler/rendezvous", 6)]
        {
            for (number, (scenario, _)) in (0..).zip(contested(task, level).take(6)) {
                let parameters =
                    if number < 3 { AWAY } else { Parameters::random(Seed::user(number).unwrap()) };
                let (_, log) =
                    rollout::fly(&scenario, &mut *crate::kessler::policies::learner(parameters)).unwrap();
                let mut episode = scenario.task().start(&scenario).unwrap();
                let mut forgetful = ActionLog::new(2, Precision::F64);
                let mut report = StepReport::default();
                for step in 0..log.len() {
                    crate::kessler::policies::learner(parameters).act(episode.observation(), &mut forgetful);
                    episode.step(forgetful.step(step), &mut report).unwrap();
                }
                assert_eq!(log, forgetful, "{task}, scenario {number}");
            }
        }
    }

    #[test]
    fn numbers_out_of_range_are_taken_as_the_nearest_in_range() {
        let (low, high) = (Parameters([-1.0; PARAMETERS]), Parameters([2.0; PARAMETERS]));
        assert_eq!(low.meaning(), Parameters([0.0; PARAMETERS]).meaning());
        assert_eq!(high.meaning(), Parameters([1.0; PARAMETERS]).meaning());
        let spans: Vec<(f64, f64)> =
            low.meaning().iter().zip(high.meaning()).map(|(low, high)| (low.1, high.1)).collect();
        assert_eq!(spans[..3], [(1.0, 25.0), (1.0, 6.0), (1.0, 25.0)]);
        assert!((spans[3].0 - 0.02).abs() < 1e-12 && (spans[3].1 - 1.0).abs() < 1e-12);
    }
}
