//! The built-in learner's policy: the proportional approach with six numbers that it has to learn.

use crate::docking::approach::Approach;
use crate::reflex::{self, Meaning, Reflex};
use crate::seed::Seed;

/// The reflex as data.
pub const REFLEX: Reflex = Reflex {
    names: &Parameters::NAMES,
    policy: |numbers| super::by_law(Parameters::of(numbers).approach()),
    meaning: |numbers| Parameters::of(numbers).meaning(),
};

/// How many numbers the policy has.
pub const PARAMETERS: usize = 6;

/// The policy's numbers, each in [0, 1]; what they mean is in [`Parameters::NAMES`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters(pub [f64; PARAMETERS]);

impl Parameters {
    /// What the numbers are, in order.
    pub const NAMES: [&str; PARAMETERS] =
        ["speed_fraction", "gain", "brake_distance", "final_speed", "brake_slope", "lateral_damping"];

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

    /// The law at these numbers. Ranges are wide on purpose: most of them crash, miss or saturate.
    #[must_use]
    pub fn approach(&self) -> Approach {
        let p = self.0.map(|v| if v.is_nan() { 0.5 } else { v.clamp(0.0, 1.0) });
        let within = |i: usize, low: f64, high: f64| low + (high - low) * p[i];
        Approach {
            fraction: within(0, 0.0, 2.5),
            gain: 0.1 * libm::pow(200.0, p[1]), // 0.1 to 20 N·s/m, evenly by ratio
            brake_distance: within(2, 0.0, 20.0),
            final_speed: within(3, 0.0, 0.6),
            brake_slope: 0.02 * libm::pow(50.0, p[4]), // 0.02 to 1 /s, evenly by ratio
            lateral: within(5, -1.0, 1.5),
            deceleration: f64::INFINITY,
        }
    }

    /// What the numbers stand for, in order.
    #[must_use]
    pub fn meaning(&self) -> Vec<Meaning> {
        let law = self.approach();
        let values = [
            (law.fraction, ""),
            (law.gain, "N·s/m"),
            (law.brake_distance, "m"),
            (law.final_speed, "m/s"),
            (law.brake_slope, "1/s"),
            (law.lateral, ""),
        ];
        let named = Self::NAMES.into_iter().zip(values);
        named.map(|(name, (value, unit))| Meaning { name, value, unit }).collect()
    }
}
