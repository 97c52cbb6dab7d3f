//! A world's trainable reflex: a policy with a few numbers and nothing that searches. It is what the demo's built-in
//! learner learns, and what `frozen` flies untrained.

use crate::policy::Policy;

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
