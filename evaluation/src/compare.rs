//! Comparison of two policies on the same scenarios.
//!
//! Scenarios differ far more than policies do, so that two means with their own intervals say little. The policies are
//! compared on each scenario first, and then the scenarios are resampled.

use api_types::PolicyComparison;

use super::bootstrap::estimate_means;
use super::results::{EpisodeMeasures, PolicyResults};

/// Compares two policies on each scenario, with 95 % percentile bootstrap intervals over scenarios.
#[must_use]
pub fn compare_policies(one: &PolicyResults, other: &PolicyResults, seed: u64) -> PolicyComparison {
    let episodes = one.episodes.iter().zip(&other.episodes);
    let means = one.scenario_means().into_iter().zip(other.scenario_means());
    let difference = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a - b);
    let rows: Vec<[Option<f64>; 4]> = episodes
        .zip(means)
        .map(|((ones, others), (mean, other))| {
            [
                difference(mean.score, other.score),
                difference(mean.success, other.success),
                difference(mean.skill, other.skill),
                share_of_higher_scores(ones, others),
            ]
        })
        .collect();
    let [score, success, skill, improvement] = estimate_means(&rows, seed);
    PolicyComparison { score, success, skill, improvement }
}

/// Returns the share of pairs of episodes in which the first has the higher score, with ties as one half.
fn share_of_higher_scores(ones: &[EpisodeMeasures], others: &[EpisodeMeasures]) -> Option<f64> {
    let scores = |episodes: &[EpisodeMeasures]| -> Vec<f64> {
        episodes.iter().filter_map(|measures| measures.score).collect()
    };
    let (ones, others) = (scores(ones), scores(others));
    if ones.is_empty() || others.is_empty() {
        return None;
    }
    let win = |a: f64, b: f64| {
        if a > b {
            1.0
        } else if a < b {
            0.0
        } else {
            0.5
        }
    };
    let wins: f64 = ones.iter().flat_map(|&a| others.iter().map(move |&b| win(a, b))).sum();
    Some(wins / (ones.len() * others.len()) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn results(scores: &[&[f64]]) -> PolicyResults {
        let episode = |score: &f64| EpisodeMeasures {
            score: Some(*score),
            success: Some(f64::from(u8::from(*score > 0.5))),
            skill: None,
            lost: Some(0.0),
            fuel_used: Some(0.0),
        };
        let episodes = scores.iter().map(|scores| scores.iter().map(episode).collect()).collect();
        PolicyResults { policy: "one".to_owned(), is_stochastic: true, episodes }
    }

    #[test]
    fn differences_pair_the_same_scenarios() {
        let (one, other) = (results(&[&[0.9, 0.7], &[0.3], &[0.2]]), results(&[&[0.6], &[0.1], &[0.2, 0.2]]));
        let comparison = compare_policies(&one, &other, 0);
        let score = comparison.score.unwrap();
        assert!((score.mean - (0.2 + 0.2 + 0.0) / 3.0).abs() < 1e-12);
        assert!(score.low <= score.mean && score.mean <= score.high && score.scenarios == 3);
        assert!((comparison.improvement.unwrap().mean - (1.0 + 1.0 + 0.5) / 3.0).abs() < 1e-12);
        assert_eq!(comparison.success.unwrap().mean, 0.0);
        assert_eq!(comparison.skill, None);
    }

    /// Paired differences of a policy with itself have an interval of no width, although the scenarios differ.
    #[test]
    fn a_policy_equals_itself() {
        let one = results(&[&[0.9], &[0.1], &[0.5], &[0.0]]);
        let PolicyComparison { score, improvement, .. } = compare_policies(&one, &one, 3);
        assert_eq!(score.map(|e| (e.mean, e.low, e.high)), Some((0.0, 0.0, 0.0)));
        assert_eq!(improvement.map(|e| (e.mean, e.low, e.high)), Some((0.5, 0.5, 0.5)));
    }

    #[test]
    fn swapped_policies_swap_the_sign() {
        let (one, other) = (results(&[&[0.9, 0.2], &[0.3], &[0.4]]), results(&[&[0.6], &[0.5], &[0.2, 0.8]]));
        let (forward, backward) = (compare_policies(&one, &other, 1), compare_policies(&other, &one, 1));
        let (a, b) = (forward.score.unwrap(), backward.score.unwrap());
        assert!((a.mean + b.mean).abs() < 1e-12);
        assert!((a.low + b.high).abs() < 1e-9 && (a.high + b.low).abs() < 1e-9);
        let improvement = forward.improvement.unwrap().mean + backward.improvement.unwrap().mean;
        assert!((improvement - 1.0).abs() < 1e-12);
    }
}
