//! Collects the differences between a recording and its replay, for every world.

use std::fmt::Arguments;

use crate::world::{FirstDifference, RecordingComparison, WorstDifference};

/// The worst difference of each quantity, and the first that exceeds its tolerance.
pub(crate) struct DifferenceTally {
    /// Requested tolerance of numbers.
    pub(crate) tolerance: f64,
    /// Index of the current episode, counted from 0.
    pub(crate) episode: usize,
    /// Number of the current step, counted from 1.
    pub(crate) step: usize,
    /// Number of compared steps.
    pub(crate) steps: usize,
    /// Intended differences, each with its reason.
    pub(crate) documented: Vec<String>,
    worst: Vec<WorstDifference>,
    /// Quantity that counts the differences that are not numeric, each as 1.
    mismatches: Option<&'static str>,
    first: Option<FirstDifference>,
}

impl DifferenceTally {
    /// Creates a tally without differences. `quantities` are the names of the numeric quantities in the order of presentation;
    /// `mismatches` follows them as the quantity of all other differences, if they are to count as one.
    pub(crate) fn new(quantities: &[&'static str], mismatches: Option<&'static str>, tolerance: f64) -> Self {
        let numeric = quantities.iter().map(|name| WorstDifference::new(name, tolerance));
        let other =
            mismatches.map(|name| WorstDifference { is_compared: true, ..WorstDifference::new(name, 0.0) });
        Self {
            tolerance,
            episode: 0,
            step: 0,
            steps: 0,
            documented: Vec::new(),
            worst: numeric.chain(other).collect(),
            mismatches,
            first: None,
        }
    }

    /// Compares two numbers of a quantity; a difference that is NaN counts as infinite. `allowed` is the world's tolerance, unless the
    /// requested one is larger. `what` names the number in the message.
    pub(crate) fn compare_numbers(
        &mut self,
        quantity: &'static str,
        ours: f64,
        theirs: f64,
        allowed: f64,
        what: Arguments<'_>,
    ) {
        let difference = if ours == theirs { 0.0 } else { (ours - theirs).abs() };
        let difference = if difference.is_nan() { f64::INFINITY } else { difference };
        let allowed = allowed.max(self.tolerance);
        self.update_worst(quantity, difference, allowed);
        if difference > allowed {
            self.set_first(format!("{what}: {ours} here, {theirs} recorded"));
        }
    }

    /// Compares two values that are not numbers, and must be equal. `what` names them in the message.
    pub(crate) fn compare_outcomes<T: PartialEq + std::fmt::Debug + ?Sized>(
        &mut self,
        ours: &T,
        theirs: &T,
        what: Arguments<'_>,
    ) {
        if ours == theirs {
            self.add_match();
        } else {
            self.add_mismatch(format!("{what}: {ours:?} here, {theirs:?} recorded"));
        }
    }

    /// Counts a comparison of values that are not numeric and are equal.
    pub(crate) fn add_match(&mut self) {
        if let Some(quantity) = self.mismatches {
            self.update_worst(quantity, 0.0, 0.0);
        }
    }

    /// Adds a difference that is not numeric.
    pub(crate) fn add_mismatch(&mut self, what: String) {
        if let Some(quantity) = self.mismatches {
            self.update_worst(quantity, 1.0, 0.0);
        }
        self.set_first(what);
    }

    fn update_worst(&mut self, quantity: &str, difference: f64, allowed: f64) {
        let worst = self.worst.iter_mut().find(|worst| worst.quantity == quantity);
        debug_assert!(worst.is_some(), "the tally has no quantity {quantity}");
        if let Some(worst) = worst {
            worst.update(difference, allowed);
        }
    }

    fn set_first(&mut self, what: String) {
        if self.first.is_none() {
            self.first = Some(FirstDifference { episode: self.episode, step: self.step, what });
        }
    }

    /// The result of the comparison of this many episodes.
    pub(crate) fn into_comparison(self, episodes: usize) -> RecordingComparison {
        RecordingComparison {
            episodes,
            steps: self.steps,
            worst: self.worst,
            first: self.first,
            documented: self.documented,
        }
    }
}
