//! A world's trainable reflex: a policy with a few numbers and nothing that searches. It is what the demo's built-in
//! learner learns, and what `frozen` flies untrained.

use crate::chance::{Chance, Seeded, Stream};
use crate::policy::Policy;
use crate::seed::Seed;

/// A reflex as data: what its numbers are, and how they become a policy.
#[derive(Debug, Clone, Copy)]
pub struct Reflex {
    /// What the numbers are called, in order; each is in [0, 1].
    pub names: &'static [&'static str],
    /// The policy at these numbers; those out of range count as the nearest in range, missing ones as ½.
    pub policy: fn(&[f64]) -> Box<dyn Policy>,
    /// What the numbers stand for, in order.
    pub meaning: fn(&[f64]) -> Vec<Meaning>,
}

/// What one number of a reflex stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Meaning {
    /// Its name.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// Its unit, empty for a pure number.
    pub unit: &'static str,
}

/// So many of these numbers; missing ones, and what is no number, are ½.
pub(crate) fn numbers<const N: usize>(given: &[f64]) -> [f64; N] {
    std::array::from_fn(|i| given.get(i).copied().filter(|v| !v.is_nan()).unwrap_or(0.5))
}

/// Uniform random numbers: what a learner starts from, and what `frozen` stays at.
pub(crate) fn random<const N: usize>(seed: Seed) -> [f64; N] {
    let mut chance = Seeded::new(seed);
    [(); N].map(|()| chance.uniform(Stream::Policy))
}
