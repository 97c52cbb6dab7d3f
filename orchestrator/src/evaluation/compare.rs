//! Two policies on the same scenarios.
//!
//! Scenarios differ far more than policies do, so that two means with their own intervals say little: what is compared is what the
//! policies did on each scenario, and only then are scenarios resampled.

use serde::Serialize;

use super::bootstrap::{Estimate, estimates};
use super::flown::{Flown, Measures};

/// What one policy did against another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Compared {
    /// Mean over scenarios of the difference of scores.
    pub score: Option<Estimate>,
    /// The same of success.
    pub success: Option<Estimate>,
    /// The same of skill, where it is defined.
    pub skill: Option<Estimate>,
    /// How likely an episode of the one has a higher score than one of the other on the same scenario, ties counting one half: the
    /// mean over scenarios (the probability of improvement of Agarwal et al. 2021, over scenarios instead of tasks).
    pub improvement: Option<Estimate>,
}

/// Compares two policies, scenario by scenario; 95 % percentile bootstrap intervals over scenarios.
#[must_use]
pub fn compare(one: &Flown, other: &Flown, seed: u64) -> Compared {
    let pairs = one.episodes.iter().zip(&other.episodes);
    let means = one.means().into_iter().zip(other.means());
    let rows: Vec<[Option<f64>; 4]> = pairs
        .zip(means)
        .map(|((ones, others), (mean, other))| {
            let gap = |column: usize| mean[column].zip(other[column]).map(|(a, b)| a - b);
            [gap(0), gap(1), gap(2), higher(ones, others)]
        })
        .collect();
    let [score, success, skill, improvement] = estimates(&rows, seed);
    Compared { score, success, skill, improvement }
}

/// The share of pairs of episodes in which the first has the higher score, ties counting one half.
fn higher(ones: &[Measures], others: &[Measures]) -> Option<f64> {
    let scores = |of: &[Measures]| of.iter().filter_map(|measures| measures[0]).collect::<Vec<f64>>();
    let (ones, others) = (scores(ones), scores(others));
    if ones.is_empty() || others.is_empty() {
        return None;
    }
    let of = |(a, b): (f64, f64)| {
        if a > b {
            1.0
        } else if a < b {
            0.0
        } else {
            0.5
        }
    };
    let all: f64 = ones.iter().flat_map(|a| others.iter().map(move |b| of((*a, *b)))).sum();
    Some(all / (ones.len() * others.len()) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flown(scores: &[&[f64]]) -> Flown {
        let episode =
            |score: &f64| [Some(*score), Some(f64::from(u8::from(*score > 0.5))), None, Some(0.0), Some(0.0)];
        let episodes = scores.iter().map(|of| of.iter().map(episode).collect()).collect();
        Flown { policy: "one".to_owned(), chance: true, episodes }
    }

    #[test]
    fn differences_are_of_the_same_scenarios() {
        let (one, other) = (flown(&[&[0.9, 0.7], &[0.3], &[0.2]]), flown(&[&[0.6], &[0.1], &[0.2, 0.2]]));
        let found = compare(&one, &other, 0);
        let score = found.score.unwrap();
        assert!((score.mean - (0.2 + 0.2 + 0.0) / 3.0).abs() < 1e-12);
        assert!(score.low <= score.mean && score.mean <= score.high && score.scenarios == 3);
        assert!((found.improvement.unwrap().mean - (1.0 + 1.0 + 0.5) / 3.0).abs() < 1e-12);
        assert_eq!(found.success.unwrap().mean, 0.0);
        assert_eq!(found.skill, None);
    }

    /// Of whatever, a comparison with itself is nothing: the interval of paired differences has no width, though the scenarios differ.
    #[test]
    fn a_policy_is_as_good_as_itself() {
        let one = flown(&[&[0.9], &[0.1], &[0.5], &[0.0]]);
        let Compared { score, improvement, .. } = compare(&one, &one, 3);
        assert_eq!(score.map(|e| (e.mean, e.low, e.high)), Some((0.0, 0.0, 0.0)));
        assert_eq!(improvement.map(|e| (e.mean, e.low, e.high)), Some((0.5, 0.5, 0.5)));
    }

    #[test]
    fn comparing_the_other_way_round_is_the_same_with_other_signs() {
        let (one, other) = (flown(&[&[0.9, 0.2], &[0.3], &[0.4]]), flown(&[&[0.6], &[0.5], &[0.2, 0.8]]));
        let (there, back) = (compare(&one, &other, 1), compare(&other, &one, 1));
        let (a, b) = (there.score.unwrap(), back.score.unwrap());
        assert!((a.mean + b.mean).abs() < 1e-12);
        assert!((a.low + b.high).abs() < 1e-9 && (a.high + b.low).abs() < 1e-9);
        assert!((there.improvement.unwrap().mean + back.improvement.unwrap().mean - 1.0).abs() < 1e-12);
    }
}
