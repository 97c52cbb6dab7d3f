//! Collects the differences between a recording and its replay.

use crate::world::{FirstDifference, RecordingComparison, WorstDifference};

/// A compared quantity, in the order of presentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ComparedQuantity {
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

/// Names of the quantities.
const QUANTITY_NAMES: [&str; 10] = [
    "state",
    "observation",
    "reward_distance",
    "reward_delta_v",
    "reward_velocity",
    "reward_success",
    "reward_failure",
    "reward",
    "return",
    // Its difference is 1 if a flag or a reason differs.
    "done",
];

/// The worst difference of each quantity, and the first that exceeds its tolerance.
pub(super) struct DifferenceTally {
    pub(super) tolerance: f64,
    /// Index of the current episode, counted from 0.
    pub(super) episode: usize,
    /// Number of the current step, counted from 1.
    pub(super) step: usize,
    /// Number of compared steps.
    pub(super) steps: usize,
    pub(super) documented: Vec<String>,
    worst: [WorstDifference; QUANTITY_NAMES.len()],
    first: Option<FirstDifference>,
}

impl DifferenceTally {
    pub(super) fn new(tolerance: f64) -> Self {
        Self {
            tolerance,
            episode: 0,
            step: 0,
            steps: 0,
            documented: Vec::new(),
            worst: QUANTITY_NAMES
                .map(|name| WorstDifference::new(name, if name == "done" { 0.0 } else { tolerance })),
            first: None,
        }
    }

    /// Compares two numbers; a difference that is NaN counts as infinite.
    pub(super) fn compare_numbers(
        &mut self,
        quantity: ComparedQuantity,
        ours: f64,
        theirs: f64,
        allowed: f64,
        of: &str,
    ) {
        let difference = if ours == theirs { 0.0 } else { (ours - theirs).abs() };
        let difference = if difference.is_nan() { f64::INFINITY } else { difference };
        self.worst[quantity as usize].update(difference, allowed);
        if difference > allowed {
            let what = QUANTITY_NAMES[quantity as usize];
            self.set_first(format!("{what} of {of}: {ours} here, {theirs} recorded"));
        }
    }

    /// Adds a difference that is not numeric.
    pub(super) fn add_mismatch(&mut self, what: String) {
        self.worst[ComparedQuantity::Done as usize].update(1.0, 0.0);
        self.set_first(what);
    }

    fn set_first(&mut self, what: String) {
        if self.first.is_none() {
            self.first = Some(FirstDifference { episode: self.episode, step: self.step, what });
        }
    }

    pub(super) fn into_comparison(self, episodes: usize) -> RecordingComparison {
        RecordingComparison {
            episodes,
            steps: self.steps,
            worst: self.worst.to_vec(),
            first: self.first,
            documented: self.documented,
        }
    }
}
