//! Several trainings of the same kind that differ by their seed: what may be said of the kind.
//!
//! Each training is one observation: its mean over the suite's scenarios. These are few and have outliers, so that their
//! interquartile mean is told, with an interval by resampling trainings (Agarwal et al. 2021, "Deep RL at the edge of the
//! statistical precipice", section 4.3). Scenarios are never trimmed: the hard ones are what a suite is for.

use serde::Serialize;

use super::bootstrap::{Estimate, estimate_by};
use super::flown::Flown;

/// What trainings of one kind came to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AcrossSeeds {
    /// Trainings.
    pub trainings: usize,
    /// Interquartile mean of their mean scores; the number of scenarios in it is that of trainings.
    pub score: Option<Estimate>,
    /// The same of the shares of success.
    pub success: Option<Estimate>,
    /// The same of skill.
    pub skill: Option<Estimate>,
}

/// Trainings from which on something is said of their kind.
pub const FEWEST: usize = 3;

/// The interquartile means over trainings, of three at least, with 95 % percentile bootstrap intervals over them.
#[must_use]
pub fn across(trainings: &[&Flown], seed: u64) -> AcrossSeeds {
    let means: Vec<[Option<f64>; 5]> = trainings
        .iter()
        .map(|flown| super::bootstrap::column_means(flown.means().iter()).map(|(mean, _)| mean))
        .collect();
    let of = |column: usize| {
        let values: Vec<f64> = means.iter().filter_map(|means| means[column]).collect();
        if values.len() < FEWEST {
            return None; // resampling so few gives what lies between the least and the most, at best
        }
        estimate_by(&values, seed, |drawn| interquartile_mean(drawn.collect()))
    };
    AcrossSeeds { trainings: trainings.len(), score: of(0), success: of(1), skill: of(2) }
}

/// The mean of the middle half: a quarter of the weight is taken away at each end, in part of a value where it must be.
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
    fn validate_the_interquartile_mean() {
        let iqm = |values: &[f64]| interquartile_mean(values.to_vec()).unwrap();
        assert_eq!(iqm(&[1.0, 2.0, 3.0, 100.0]), 2.5);
        assert_eq!(iqm(&[7.0]), 7.0);
        // Of five, the middle one and three quarters of its neighbours: (0.75·2 + 3 + 0.75·4)/2.5.
        assert!((iqm(&[-50.0, 2.0, 3.0, 4.0, 90.0]) - 3.0).abs() < 1e-12);
        assert_eq!(interquartile_mean(Vec::new()), None);
    }

    #[test]
    fn trainings_are_resampled_and_scenarios_are_not() {
        let flown = |score: f64| Flown {
            policy: "one".to_owned(),
            chance: false,
            episodes: [0.0, 1.0]
                .map(|other| vec![[Some(0.5 * (score + other)), None, None, None, None]])
                .to_vec(),
        };
        let same = [flown(0.4), flown(0.4), flown(0.4)];
        let found = across(&same.iter().collect::<Vec<_>>(), 0);
        let score = found.score.unwrap();
        // Scenarios differ and trainings do not: there is no interval.
        assert!((score.mean - 0.45).abs() < 1e-12 && (score.high - score.low).abs() < 1e-12, "{score:?}");
        assert_eq!((found.trainings, found.success), (3, None));
    }
}
