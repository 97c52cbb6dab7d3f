//! The trainable reflex: the approach law with six learnable parameters.

use crate::docking::approach_law::ApproachLaw;
use crate::reflex::{self, ParameterMeaning, Reflex};
use crate::seed::Seed;

/// The reflex of docking.
pub const DOCKING_REFLEX: Reflex = Reflex {
    names: &DockingReflexParameters::NAMES,
    policy: |numbers| super::approach_policy(DockingReflexParameters::from_numbers(numbers).approach()),
    meaning: |numbers| DockingReflexParameters::from_numbers(numbers).meanings(),
};

/// Number of parameters of the reflex.
pub const DOCKING_REFLEX_LEN: usize = 6;

/// Parameters of the reflex, each in [0, 1]; their names are [`DockingReflexParameters::NAMES`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DockingReflexParameters(pub [f64; DOCKING_REFLEX_LEN]);

impl DockingReflexParameters {
    /// Names of the parameters in order.
    pub const NAMES: [&str; DOCKING_REFLEX_LEN] =
        ["speed_fraction", "gain", "brake_distance", "final_speed", "brake_slope", "lateral_damping"];

    /// Creates parameters from numbers; missing ones are ½.
    #[must_use]
    pub fn from_numbers(numbers: &[f64]) -> Self {
        Self(reflex::parameter_array(numbers))
    }

    /// Samples uniform random parameters: the learner starts from them, and `frozen` keeps them.
    #[must_use]
    pub fn random(seed: Seed) -> Self {
        Self(reflex::random_parameters(seed))
    }

    /// The approach law with these parameters. Ranges are wide on purpose: most laws crash, miss or saturate.
    #[must_use]
    pub fn approach(&self) -> ApproachLaw {
        let p = reflex::clamp_parameters(self.0);
        let scale = |i: usize, low: f64, high: f64| low + (high - low) * p[i];
        ApproachLaw {
            speed_fraction: scale(0, 0.0, 2.5),
            gain: 0.1 * libm::pow(200.0, p[1]), // 0.1 to 20 N·s/m, log-uniform
            brake_distance: scale(2, 0.0, 20.0),
            final_speed: scale(3, 0.0, 0.6),
            brake_slope: 0.02 * libm::pow(50.0, p[4]), // 0.02 to 1 /s, log-uniform
            lateral_ratio: scale(5, -1.0, 1.5),
            deceleration: f64::INFINITY,
        }
    }

    /// Physical meanings of the parameters in order.
    #[must_use]
    pub fn meanings(&self) -> Vec<ParameterMeaning> {
        let law = self.approach();
        let values = [
            (law.speed_fraction, ""),
            (law.gain, "N·s/m"),
            (law.brake_distance, "m"),
            (law.final_speed, "m/s"),
            (law.brake_slope, "1/s"),
            (law.lateral_ratio, ""),
        ];
        let named = Self::NAMES.into_iter().zip(values);
        named.map(|(name, (value, unit))| ParameterMeaning { name, value, unit }).collect()
    }
}
