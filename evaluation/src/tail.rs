//! The tail of the scores: the mean score over the tenth of the scenarios with the lowest scores (conditional value at
//! risk).
//!
//! If a policy is stochastic, the scenarios with the lowest means are partly those with bad luck, and their mean
//! underestimates the policy. Scenarios are therefore ranked by one half of their episodes and scored by the other half,
//! then the other way round, and the mean of both is the estimate.

use api_types::Estimate;

use super::bootstrap::estimate_statistic;
use super::results::{EpisodeMeasures, PolicyResults};

/// Share of the scenarios in the tail.
pub const TAIL_SHARE: f64 = 0.1;
/// Minimum number of episodes on each scenario for a stochastic policy: four in each half.
pub const MIN_EPISODES: usize = 8;

/// Scores of the two halves of a scenario's episodes.
#[derive(Debug, Clone, Copy)]
struct HalfScores {
    /// Mean score of the half that ranks the scenario.
    rank: f64,
    /// Mean score of the half that is reported.
    score: f64,
}

impl HalfScores {
    /// Exchanges the two halves.
    const fn swapped(self) -> Self {
        Self { rank: self.score, score: self.rank }
    }
}

/// Estimates the mean score over the tail, with a 95 % percentile bootstrap interval over scenarios.
///
/// `None` without episodes on some scenario, or with fewer than [`MIN_EPISODES`] of a stochastic policy.
#[must_use]
pub fn cvar(results: &PolicyResults, seed: u64) -> Option<Estimate> {
    let min_episodes = if results.is_stochastic { MIN_EPISODES } else { 1 };
    if results.episodes.is_empty() || results.episodes.iter().any(|episodes| episodes.len() < min_episodes) {
        return None;
    }
    let halves: Vec<HalfScores> = results.episodes.iter().map(|episodes| half_scores(episodes)).collect();
    estimate_statistic(&halves, seed, |resample| {
        Some(0.5 * (tail_mean(resample.clone()) + tail_mean(resample.map(HalfScores::swapped))))
    })
}

/// Returns the mean scores of the episodes with even and with odd indices; a single episode is in both halves.
fn half_scores(episodes: &[EpisodeMeasures]) -> HalfScores {
    let mean = |half: &mut dyn Iterator<Item = &EpisodeMeasures>| {
        let scores = half.filter_map(|measures| measures.score);
        let (sum, n) = scores.fold((0.0, 0u32), |(sum, n), score| (sum + score, n + 1));
        (n > 0).then(|| sum / f64::from(n))
    };
    let even = mean(&mut episodes.iter().step_by(2)).unwrap_or(0.0);
    let odd = mean(&mut episodes.iter().skip(1).step_by(2));
    HalfScores { rank: even, score: odd.unwrap_or(even) }
}

/// Returns the mean score of the scenarios with the lowest ranks. Scenarios at the edge of the tail share its last places.
fn tail_mean(scenarios: impl Iterator<Item = HalfScores>) -> f64 {
    let scenarios: Vec<HalfScores> = scenarios.collect();
    let mut ranks: Vec<f64> = scenarios.iter().map(|scenario| scenario.rank).collect();
    // The last scenario may count partly.
    let places = TAIL_SHARE * scenarios.len() as f64;
    let Some(last) = (places.ceil() as usize).checked_sub(1) else { return 0.0 };
    let (_, &mut edge, _) = ranks.select_nth_unstable_by(last, f64::total_cmp);
    let sum_where = |matches: &dyn Fn(f64) -> bool| {
        let scores =
            scenarios.iter().filter(|scenario| matches(scenario.rank)).map(|scenario| scenario.score);
        scores.fold((0.0, 0.0), |(sum, n), score| (sum + score, n + 1.0))
    };
    let (below, n) = sum_where(&|rank| rank < edge);
    let (tied, ties) = sum_where(&|rank| rank == edge);
    let share = (places - n) / ties;
    (below + share * tied) / places
}

#[cfg(test)]
mod tests {
    use env_core::KeyedRng;
    use env_core::keyed_rng::RngPurpose;

    use super::*;

    fn results(is_stochastic: bool, scores: Vec<Vec<f64>>) -> PolicyResults {
        let episode = |score: f64| EpisodeMeasures { score: Some(score), ..EpisodeMeasures::default() };
        let episodes = scores.into_iter().map(|scores| scores.into_iter().map(episode).collect()).collect();
        PolicyResults { policy: "one".to_owned(), is_stochastic, episodes }
    }

    #[test]
    fn validate_deterministic_tail_is_the_lowest_tenth() {
        let scores = (0..50).map(|n| vec![f64::from(n) / 50.0]).collect();
        let estimate = cvar(&results(false, scores), 0).unwrap();
        assert!((estimate.mean - (0.0 + 1.0 + 2.0 + 3.0 + 4.0) / 250.0).abs() < 1e-12, "{estimate:?}");
        assert!(estimate.low <= estimate.mean && estimate.mean <= estimate.high);
        // The tail of 25 scenarios is two and a half of them: the third counts half.
        let scores = (0..25).map(|n| vec![f64::from(n)]).collect();
        let mean = cvar(&results(false, scores), 0).unwrap().mean;
        assert!((mean - (0.0 + 1.0 + 0.5 * 2.0) / 2.5).abs() < 1e-12);
    }

    /// All scenarios are alike and differ by chance only, so that the tail is as good as the mean. Ranked and scored by the
    /// same episodes it would be lower by 1.75 standard deviations of the mean of eight, which is 0.31 (the mean of the
    /// lowest tenth of a normal distribution).
    #[test]
    fn bad_luck_does_not_lower_the_tail() {
        let mut draws = KeyedRng::new(RngPurpose::Simulation, 1, 2);
        let scores: Vec<Vec<f64>> =
            (0..400).map(|_| (0..8).map(|_| f64::from(u8::from(draws.bernoulli(0.5)))).collect()).collect();
        let naive = {
            let mut means: Vec<f64> = scores.iter().map(|scores| scores.iter().sum::<f64>() / 8.0).collect();
            means.sort_by(f64::total_cmp);
            means[..40].iter().sum::<f64>() / 40.0
        };
        let estimate = cvar(&results(true, scores), 0).unwrap();
        assert!(naive < 0.25, "{naive}");
        // 40 scenarios of four episodes, twice: three standard deviations of 0.5/√320 = 0.028.
        assert!((estimate.mean - 0.5).abs() < 0.085, "{estimate:?}");
        assert!(estimate.low <= 0.5 && 0.5 <= estimate.high, "{estimate:?}");
    }

    #[test]
    fn too_few_episodes_give_no_estimate() {
        assert_eq!(cvar(&results(true, vec![vec![0.5; 7]; 30]), 0), None);
        assert!(cvar(&results(true, vec![vec![0.5; 8]; 30]), 0).is_some());
        assert_eq!(cvar(&results(false, Vec::new()), 0), None);
    }
}
