//! Counting what differs.

use crate::world::{Compared, FirstDifference};

/// What is compared, in the order people should read it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    State,
    Observation,
    Distance,
    DeltaV,
    Velocity,
    Success,
    Failure,
    Reward,
    Return,
    Done,
}

const NAMES: [&str; 10] = [
    "state",
    "observation",
    "reward: distance",
    "reward: delta-v",
    "reward: velocity",
    "reward: success",
    "reward: failure",
    "reward",
    "return",
    "done (1: a flag or a reason differs)",
];

/// The worst of each, and where the first too large one stands.
pub(super) struct Tally {
    pub(super) tolerance: f64,
    /// Where we are: counted from 0, and from 1.
    pub(super) episode: usize,
    pub(super) step: usize,
    /// Steps compared.
    pub(super) steps: usize,
    pub(super) documented: Vec<String>,
    worst: [f64; NAMES.len()],
    first: Option<FirstDifference>,
}

impl Tally {
    pub(super) const fn new(tolerance: f64) -> Self {
        Self {
            tolerance,
            episode: 0,
            step: 0,
            steps: 0,
            documented: Vec::new(),
            worst: [0.0; NAMES.len()],
            first: None,
        }
    }

    /// Compares two numbers; NaN counts as infinitely far.
    pub(super) fn number(&mut self, quantity: Quantity, ours: f64, theirs: f64, allowed: f64, of: &str) {
        let difference = if ours == theirs { 0.0 } else { (ours - theirs).abs() };
        let difference = if difference.is_nan() { f64::INFINITY } else { difference };
        let worst = &mut self.worst[quantity as usize];
        *worst = worst.max(difference);
        if difference > allowed {
            let what = NAMES[quantity as usize];
            self.note(format!("{what} of {of}: {ours} here, {theirs} recorded"));
        }
    }

    /// Something that is not a number differs.
    pub(super) fn differ(&mut self, what: String) {
        self.worst[Quantity::Done as usize] = 1.0;
        self.note(what);
    }

    fn note(&mut self, what: String) {
        if self.first.is_none() {
            self.first = Some(FirstDifference { episode: self.episode, step: self.step, what });
        }
    }

    pub(super) fn compared(self, episodes: usize) -> Compared {
        Compared {
            episodes,
            steps: self.steps,
            worst: NAMES.into_iter().zip(self.worst).collect(),
            first: self.first,
            documented: self.documented,
        }
    }
}
