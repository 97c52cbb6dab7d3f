//! The trainable rule: thresholds of charge, wheels and storage, and a horizon for targets.

use super::blind::BlindAction;
use super::telemetry::{TargetTelemetry, TaskedSatelliteTelemetry};
use crate::reflex::{self, ParameterMeaning};
use crate::seed::Seed;

/// Number of parameters of the rule.
const LEN: usize = 5;

/// Time of an image without a turn, s.
const IMAGE_S: f64 = 37.0;
/// Time that a turn takes for each degree, s.
const TURN_S_PER_DEG: f64 = 0.34;
/// Share of its worth that a target keeps whose window is likely to close before the image.
const CLOSING_WORTH: f64 = 0.05;

/// A rule by thresholds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TaskingRule {
    /// Charge below which the satellite charges, as a share of the battery.
    pub charge_below: f64,
    /// Longest time until the next eclipse for which charging is worth it, s; beyond it the threshold is halved.
    pub eclipse_within_s: f64,
    /// Speed of a wheel above which the satellite desaturates, as a share of the limit.
    pub desaturate_above: f64,
    /// Data above which the satellite downlinks in view of a station, as a share of the storage.
    pub downlink_above: f64,
    /// Time until the image of a target that halves its worth, s.
    pub patience_s: f64,
}

impl TaskingRule {
    /// Names of the parameters in order.
    pub(super) const NAMES: [&'static str; LEN] =
        ["charge_below", "eclipse_within", "desaturate_above", "downlink_above", "patience"];

    /// The rule of the policy `heuristic`.
    pub(super) const HEURISTIC: Self = Self {
        charge_below: 0.4,
        eclipse_within_s: 1200.0,
        desaturate_above: 0.15,
        downlink_above: 0.3,
        patience_s: 15.0,
    };

    /// Creates the rule from parameters in [0, 1]; missing ones are ½.
    pub(super) fn from_numbers(numbers: &[f64]) -> Self {
        Self::from_parameters(reflex::parameter_array(numbers))
    }

    /// Samples uniform random parameters: the learner starts from them, and `frozen` keeps them.
    pub(super) fn random(seed: Seed) -> Self {
        Self::from_parameters(reflex::random_parameters(seed))
    }

    fn from_parameters(parameters: [f64; LEN]) -> Self {
        let p = reflex::clamp_parameters(parameters);
        Self {
            charge_below: p[0],
            eclipse_within_s: 6000.0 * p[1],
            desaturate_above: p[2],
            downlink_above: p[3],
            patience_s: 10.0 * libm::pow(100.0, p[4]), // 10 to 1000 s, log-uniform
        }
    }

    /// Physical meanings of the parameters in order.
    pub(super) fn meanings(&self) -> Vec<ParameterMeaning> {
        let values = [
            (self.charge_below, ""),
            (self.eclipse_within_s, "s"),
            (self.desaturate_above, ""),
            (self.downlink_above, ""),
            (self.patience_s, "s"),
        ];
        let named = Self::NAMES.into_iter().zip(values);
        named.map(|(name, (value, unit))| ParameterMeaning { name, value, unit }).collect()
    }

    /// The action of a satellite.
    pub(super) fn choose(&self, satellite: &TaskedSatelliteTelemetry) -> BlindAction {
        let fastest = satellite.wheels.iter().fold(0.0_f64, |fastest, speed| fastest.max(speed.abs()));
        if fastest > self.desaturate_above {
            return BlindAction::Desaturate;
        }
        // The next end of an eclipse comes before its next start while the satellite is in shadow.
        let is_dark = satellite.eclipse_end_s < satellite.eclipse_start_s;
        let share = if satellite.eclipse_start_s <= self.eclipse_within_s { 1.0 } else { 0.5 };
        if !is_dark && satellite.battery < self.charge_below * share {
            return BlindAction::Charge;
        }
        if satellite.storage > self.downlink_above && satellite.station_open_s <= 0.0 {
            return BlindAction::Downlink;
        }
        BlindAction::Work(self.best_target(&satellite.targets))
    }

    /// Index of the target that is worth most.
    fn best_target(&self, targets: &[TargetTelemetry]) -> usize {
        let worth = |target: &TargetTelemetry| {
            let duration_s = (IMAGE_S + TURN_S_PER_DEG * target.angle_deg).max(target.open_s);
            let reachable = if target.close_s > duration_s { 1.0 } else { CLOSING_WORTH };
            target.priority * reachable / (1.0 + duration_s / self.patience_s)
        };
        let worths = targets.iter().map(worth).enumerate();
        worths
            .fold(
                (0, f64::NEG_INFINITY),
                |best, (index, worth)| if worth > best.1 { (index, worth) } else { best },
            )
            .0
    }
}
