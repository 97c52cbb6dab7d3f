//! Policy of the trainable reflex.

use super::common::{keep_formation, log_burn};
use super::debris_forecast::DebrisForecast;
use super::reflex_parameters::{KesslerReflexParameters, ReflexGains};
use crate::kessler::constants::SATELLITES;
use crate::kessler::kernel::{Body, Gravity};
use crate::kessler::planner::transfer::radius_feedback;
use crate::kessler::telemetry::KesslerTelemetry;
use crate::log::ActionLog;
use crate::policy::TypedPolicy;

/// Policy with fixed reflex parameters. It caches forecasts between steps; the cache does not change its
/// actions.
pub(super) struct KesslerReflexPolicy {
    gains: ReflexGains,
    forecast: DebrisForecast,
    /// Part of each satellite's hold path that is known to be clear of debris.
    clear: [Option<ClearPath>; SATELLITES],
}

/// Start of a hold path without a close approach.
#[derive(Clone, Copy)]
struct ClearPath {
    /// State of the satellite after `steps` steps.
    body: Body,
    /// Number of steps known to be clear.
    steps: usize,
}

impl KesslerReflexPolicy {
    pub(super) fn new(parameters: KesslerReflexParameters) -> Self {
        Self { gains: parameters.gains(), forecast: DebrisForecast::default(), clear: [None; SATELLITES] }
    }

    /// Burn (dvx, dvy) that avoids the first close approach ahead, if there is one.
    fn avoidance_burn(&mut self, index: usize, satellite: &Body) -> Option<(f64, f64)> {
        let miss = self.first_miss_vector(index, satellite)?;
        let distance = (miss.0 * miss.0 + miss.1 * miss.1).sqrt().max(1e-9);
        let ((rx, ry), (tx, ty)) = satellite.local_axes();
        let radial = (miss.0 * rx + miss.1 * ry) / distance;
        let in_track = (miss.0 * tx + miss.1 * ty) / distance;
        let [rr, rt, tr, tt] = self.gains.map;
        let (dr, dt) = (rr * radial + rt * in_track, tr * radial + tt * in_track);
        let length = (dr * dr + dt * dt).sqrt().max(1e-9);
        let (dr, dt) = (self.gains.size * dr / length, self.gains.size * dt / length);
        Some((dr * rx + dt * tx, dr * ry + dt * ty))
    }

    /// Miss vector of the first debris that comes closer than the threshold, seen from the satellite, LU.
    fn first_miss_vector(&mut self, index: usize, satellite: &Body) -> Option<(f64, f64)> {
        let limit_2 = self.gains.threshold * self.gains.threshold;
        let last = self.gains.look_ahead.min(self.gains.wait).min(self.forecast.len());
        let mut path = self.clear[index].take().unwrap_or(ClearPath { body: *satellite, steps: 0 });
        while path.steps < last {
            let next = path.body.coast(Gravity::Point);
            if let Some(column) = self.forecast.nearest(path.steps, &next, limit_2) {
                return Some(self.forecast.miss_vector(column, path.steps, next));
            }
            path = ClearPath { body: next, steps: path.steps + 1 };
        }
        self.clear[index] = Some(path);
        None
    }

    /// Burn (dvx, dvy) of the transfer to the target radius, if it is above the deadband.
    fn transfer_burn(&self, satellite: &Body) -> Option<(f64, f64)> {
        let gains = &self.gains;
        let ((rx, ry), (tx, ty)) = satellite.local_axes();
        let (dr, dt) =
            radius_feedback(satellite, satellite.radius(), gains.gain, gains.circularise, gains.climb);
        ((dr * dr + dt * dt).sqrt() >= gains.deadband).then_some((dr * rx + dt * tx, dr * ry + dt * ty))
    }
}

impl TypedPolicy<KesslerTelemetry> for KesslerReflexPolicy {
    fn append_actions(&mut self, telemetry: &KesslerTelemetry, log: &mut ActionLog) {
        if self.forecast.update(&telemetry.radar_debris, self.gains.look_ahead) {
            // One step has passed as forecast: each clear path is one step shorter.
            for clear in &mut self.clear {
                *clear = clear.take().and_then(|path| {
                    let steps = path.steps.checked_sub(1)?;
                    Some(ClearPath { steps, ..path })
                });
            }
        } else {
            self.clear = [None; SATELLITES];
        }
        let formation = keep_formation(telemetry, &self.gains.formation_gains());
        let satellites = telemetry.satellites.iter().enumerate().take(SATELLITES);
        for (index, s) in satellites.filter(|(_, s)| s.is_active()) {
            let burn = self.avoidance_burn(index, &s.body()).or_else(|| {
                let has_target = s.id == 0 && telemetry.target_radius > 0.0;
                if has_target { self.transfer_burn(&s.body()) } else { formation.get(index).copied() }
            });
            if burn.is_some() {
                self.clear[index] = None;
            }
            log_burn(s, burn, log);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::kessler::policies::reflex_policy;
    use crate::log::Precision;
    use crate::seed::Seed;
    use crate::task::StepReport;
    use crate::{Bracket, Recipe, Scenario, SuccessRule, admission, rollout};

    /// Parameters that forecast 20 steps, keep 2 LU, act 9 steps before and burn 0.15 LU/TU away from the
    /// debris.
    const BURN_AWAY: KesslerReflexParameters =
        KesslerReflexParameters([0.8, 0.22, 0.35, 0.515, 0.0, 0.5, 0.5, 0.0, 0.3, 0.5, 0.5, 0.2]);

    fn contested(task: &str, level: usize) -> impl Iterator<Item = (Scenario, Bracket)> {
        let task = crate::task(task).unwrap();
        let recipe = Arc::new(Recipe::at_level(task, level).unwrap());
        (0..).filter_map(move |seed| {
            let scenario = Scenario::new(Arc::clone(&recipe), Seed::user(seed).unwrap());
            let admission = admission::admit(&scenario);
            admission.bracket.filter(|_| admission.contested).map(|bracket| (scenario, bracket))
        })
    }

    fn success_rate(task: &str, level: usize, parameters: KesslerReflexParameters) -> f64 {
        let n = 60;
        let succeeds = |(scenario, bracket): &(Scenario, Bracket)| {
            let outcome = rollout::roll_out(scenario, &mut *reflex_policy(parameters)).unwrap().outcome;
            admission::is_success(scenario, SuccessRule::Task, bracket, &outcome)
        };
        contested(task, level).take(n).filter(succeeds).count() as f64 / n as f64
    }

    /// The map can be learnt: the same reflex that burns away from debris succeeds, and one that burns
    /// towards it fails.
    #[test]
    fn burning_away_beats_burning_towards() {
        for task in ["kessler/survival", "kessler/eco_station"] {
            let mut towards = BURN_AWAY;
            (towards.0[4], towards.0[7]) = (1.0, 1.0);
            let (away, towards) = (success_rate(task, 4, BURN_AWAY), success_rate(task, 4, towards));
            assert!(away > 0.9 && towards < away - 0.3, "{task}: away {away}, towards {towards}");
        }
    }

    /// The policy acts like one whose cache is cleared after every step.
    #[test]
    fn cached_forecasts_change_no_action() {
        for (task, level) in [("kessler/survival", 5), ("kessler/eco_station", 7), ("kessler/rendezvous", 6)]
        {
            for (number, (scenario, _)) in (0..).zip(contested(task, level).take(6)) {
                let parameters = if number < 3 {
                    BURN_AWAY
                } else {
                    KesslerReflexParameters::random(Seed::user(number).unwrap())
                };
                let log = rollout::roll_out(&scenario, &mut *reflex_policy(parameters)).unwrap().log;
                let mut episode = scenario.task().start(&scenario).unwrap();
                let mut uncached = ActionLog::new(2, Precision::F64);
                let mut report = StepReport::default();
                for step in 0..log.len() {
                    reflex_policy(parameters).act(episode.observation(), &mut uncached).unwrap();
                    episode.step(uncached.step(step), &mut report).unwrap();
                }
                assert_eq!(log, uncached, "{task}, scenario {number}");
            }
        }
    }
}
