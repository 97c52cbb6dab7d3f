//! Counting what differs.

use crate::world::{Compared, FirstDifference, Worst};

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
    "reward_distance",
    "reward_delta_v",
    "reward_velocity",
    "reward_success",
    "reward_failure",
    "reward",
    "return",
    // 1 where a flag or a reason differs.
    "done",
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
    worst: [Worst; NAMES.len()],
    first: Option<FirstDifference>,
}

impl Tally {
    pub(super) fn new(tolerance: f64) -> Self {
        Self {
            tolerance,
            episode: 0,
            step: 0,
            steps: 0,
            documented: Vec::new(),
            worst: NAMES.map(|name| Worst::none(name, if name == "done" { 0.0 } else { tolerance })),
            first: None,
        }
    }

    /// Compares two numbers; NaN counts as infinitely far.
    pub(super) fn number(&mut self, quantity: Quantity, ours: f64, theirs: f64, allowed: f64, of: &str) {
        let difference = if ours == theirs { 0.0 } else { (ours - theirs).abs() };
        let difference = if difference.is_nan() { f64::INFINITY } else { difference };
        self.worst[quantity as usize].take(difference, allowed);
        if difference > allowed {
            let what = NAMES[quantity as usize];
            self.note(format!("{what} of {of}: {ours} here, {theirs} recorded"));
        }
    }

    /// Something that is not a number differs.
    pub(super) fn differ(&mut self, what: String) {
        self.worst[Quantity::Done as usize].take(1.0, 0.0);
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
            worst: self.worst.to_vec(),
            first: self.first,
            documented: self.documented,
        }
    }
}
