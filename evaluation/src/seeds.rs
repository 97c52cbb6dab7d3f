//! Estimates over several trainings that differ only by their seed.
//!
//! Each training is one observation: its mean over the suite's scenarios. Trainings are few and have outliers. The estimate
//! is their interquartile mean, with an interval by resampling trainings (Agarwal et al. 2021, "Deep RL at the edge of the
//! statistical precipice", section 4.3). Scenarios are never trimmed: a suite exists for its hard ones.

use api_types::AcrossSeeds;

use super::bootstrap::estimate_statistic;
use super::results::{EpisodeMeasures, PolicyResults};

/// Minimum number of trainings for an estimate.
pub const MIN_TRAININGS: usize = 3;

/// Estimates the interquartile means over [`MIN_TRAININGS`] trainings or more, with 95 % percentile bootstrap intervals.
#[must_use]
pub fn estimate_across_seeds(trainings: &[&PolicyResults], seed: u64) -> AcrossSeeds {
    let means: Vec<EpisodeMeasures> =
        trainings.iter().map(|results| EpisodeMeasures::mean_of(&results.scenario_means())).collect();
    let estimate = |measure: fn(&EpisodeMeasures) -> Option<f64>| {
        let values: Vec<f64> = means.iter().filter_map(measure).collect();
        if values.len() < MIN_TRAININGS {
            return None; // resamples of so few values only span their minimum and maximum
        }
        estimate_statistic(&values, seed, |resample| interquartile_mean(resample.collect()))
    };
    AcrossSeeds {
        trainings: trainings.len(),
        score: estimate(|means| means.score),
        success: estimate(|means| means.success),
        skill: estimate(|means| means.skill),
    }
}

/// Returns the mean of the middle half: a quarter of the total weight is cut at each end, partial values included.
fn interquartile_mean(mut values: Vec<f64>) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    values.sort_by(f64::total_cmp);
    let n = values.len() as f64;
    let (from, to) = (0.25 * n, 0.75 * n);
    let weight = |at: usize| ((at as f64 + 1.0).min(to) - (at as f64).max(from)).max(0.0);
    let sum: f64 = values.iter().enumerate().map(|(at, value)| weight(at) * value).sum();
    Some(sum / (to - from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validate_interquartile_mean() {
        let iqm = |values: &[f64]| interquartile_mean(values.to_vec()).unwrap();
        assert_eq!(iqm(&[1.0, 2.0, 3.0, 100.0]), 2.5);
        assert_eq!(iqm(&[7.0]), 7.0);
        // For five values, the middle one and three quarters of its neighbours: (0.75·2 + 3 + 0.75·4)/2.5.
        assert!((iqm(&[-50.0, 2.0, 3.0, 4.0, 90.0]) - 3.0).abs() < 1e-12);
        assert_eq!(interquartile_mean(Vec::new()), None);
    }

    #[test]
    fn only_trainings_are_resampled() {
        let episode = |score: f64| EpisodeMeasures { score: Some(score), ..EpisodeMeasures::default() };
        let results = |score: f64| PolicyResults {
            policy: "one".to_owned(),
            is_stochastic: false,
            episodes: [0.0, 1.0].map(|other| vec![episode(0.5 * (score + other))]).to_vec(),
        };
        let trainings = [results(0.4), results(0.4), results(0.4)];
        let estimates = estimate_across_seeds(&trainings.iter().collect::<Vec<_>>(), 0);
        let score = estimates.score.unwrap();
        // Scenarios differ and trainings do not: the interval has no width.
        assert!((score.mean - 0.45).abs() < 1e-12 && (score.high - score.low).abs() < 1e-12, "{score:?}");
        assert_eq!((estimates.trainings, estimates.success), (3, None));
    }
}
