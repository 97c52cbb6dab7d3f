//! A world's trainable reflex: a policy with a few parameters and no search. The built-in learner of the demo trains it, and
//! the policy `frozen` is an untrained one.

use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::policy::Policy;
use crate::seed::Seed;

/// A reflex as data: its parameters, and how to create the policy.
#[derive(Debug, Clone, Copy)]
pub struct Reflex {
    /// Names of the parameters, in order; each parameter is in [0, 1].
    pub names: &'static [&'static str],
    /// Creates the policy with these parameters; values out of range are clamped, missing ones are ½.
    pub policy: fn(&[f64]) -> Box<dyn Policy>,
    /// Computes the physical meanings of the parameters, in order.
    pub meaning: fn(&[f64]) -> Vec<ParameterMeaning>,
}

/// Physical meaning of one parameter of a reflex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterMeaning {
    /// Name of the parameter.
    pub name: &'static str,
    /// Value in the physical unit.
    pub value: f64,
    /// Unit of the value, empty for a pure number.
    pub unit: &'static str,
}

/// The first `N` parameters; missing ones are ½.
pub(crate) fn parameter_array<const N: usize>(given: &[f64]) -> [f64; N] {
    std::array::from_fn(|i| given.get(i).copied().unwrap_or(0.5))
}

/// Clamps parameters to [0, 1]; NaN becomes ½.
pub(crate) fn clamp_parameters<const N: usize>(parameters: [f64; N]) -> [f64; N] {
    parameters.map(|v| if v.is_nan() { 0.5 } else { v.clamp(0.0, 1.0) })
}

/// Samples uniform random parameters: a learner starts from them, and `frozen` keeps them.
pub(crate) fn random_parameters<const N: usize>(seed: Seed) -> [f64; N] {
    let mut rng = SeededRng::new(seed);
    [(); N].map(|()| rng.uniform(RngStream::Policy))
}
