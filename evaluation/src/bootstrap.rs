//! Confidence intervals by the percentile bootstrap (Efron & Tibshirani 1993, ch. 13).

use std::borrow::Borrow;

use api_types::Estimate;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Number of resamples, drawn with replacement.
pub const RESAMPLES: usize = 2000;
/// Share of the resampled statistics that lie in an interval.
pub const CONFIDENCE: f64 = 0.95;

/// Mean of a column over the rows that define it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColumnMean {
    /// Mean; `None` if no row defines the column.
    pub mean: Option<f64>,
    /// Number of rows that define the column.
    pub count: usize,
}

/// Estimates the mean of each column of `rows`; `None` for a column that no row defines.
///
/// Whole rows are drawn, so that all columns see the same resamples. A resample without a defined value is left out of that
/// column. The same rows and seed give the same bits.
#[must_use]
pub fn estimate_means<const M: usize>(rows: &[[Option<f64>; M]], seed: u64) -> [Option<Estimate>; M] {
    let mut generator = generator(seed);
    let mut means: [Vec<f64>; M] = std::array::from_fn(|_| Vec::with_capacity(RESAMPLES));
    if rows.is_empty() {
        return [None; M];
    }
    for _ in 0..RESAMPLES {
        let drawn = (0..rows.len()).map(|_| &rows[draw_below(rows.len(), &mut generator)]);
        for (column, resampled) in means.iter_mut().zip(column_means(drawn)) {
            column.extend(resampled.mean);
        }
    }
    let totals = column_means(rows.iter());
    std::array::from_fn(|column| {
        let ColumnMean { mean, count: scenarios } = totals[column];
        let resampled = &mut means[column];
        resampled.sort_by(f64::total_cmp);
        let tail = 0.5 * (1.0 - CONFIDENCE);
        Some(Estimate {
            mean: mean?,
            low: quantile(resampled, tail)?,
            high: quantile(resampled, 1.0 - tail)?,
            scenarios,
        })
    })
}

/// Replaces the interval of a share that is 0 or 1 on every scenario by the exact binomial one (Clopper & Pearson 1934,
/// Biometrika 26, p. 404). Resamples of equal values would give an interval of no width, however few scenarios there are.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "numbers of scenarios are small")]
pub fn with_exact_interval(estimate: Estimate) -> Estimate {
    let tail = 0.5 * (1.0 - CONFIDENCE);
    // For n successes of n, the lower end is the p with pⁿ = tail.
    let end = libm::pow(tail, 1.0 / estimate.scenarios.max(1) as f64);
    if estimate.mean <= 0.0 {
        Estimate { low: 0.0, high: 1.0 - end, ..estimate }
    } else if estimate.mean >= 1.0 {
        Estimate { low: end, high: 1.0, ..estimate }
    } else {
        estimate
    }
}

/// Estimates any statistic of scenarios; `None` if it is not defined over all of them.
///
/// The same scenarios and seed give the same bits.
#[must_use]
pub fn estimate_statistic<T: Copy>(
    scenarios: &[T],
    seed: u64,
    statistic: impl Fn(Resample<'_, T>) -> Option<f64>,
) -> Option<Estimate> {
    let whole: Vec<usize> = (0..scenarios.len()).collect();
    let mean = statistic(Resample { scenarios, indices: whole.iter() })?;
    let mut generator = generator(seed);
    let mut resampled: Vec<f64> = (0..RESAMPLES)
        .filter_map(|_| {
            let drawn: Vec<usize> =
                whole.iter().map(|_| draw_below(scenarios.len(), &mut generator)).collect();
            statistic(Resample { scenarios, indices: drawn.iter() })
        })
        .collect();
    resampled.sort_by(f64::total_cmp);
    let tail = 0.5 * (1.0 - CONFIDENCE);
    let (low, high) = (quantile(&resampled, tail)?, quantile(&resampled, 1.0 - tail)?);
    Some(Estimate { mean, low, high, scenarios: scenarios.len() })
}

/// Iterator over the scenarios of one resample.
#[derive(Debug, Clone)]
pub struct Resample<'a, T> {
    scenarios: &'a [T],
    indices: std::slice::Iter<'a, usize>,
}

impl<T: Copy> Iterator for Resample<'_, T> {
    type Item = T;

    fn next(&mut self) -> Option<T> {
        self.scenarios.get(*self.indices.next()?).copied()
    }
}

/// Returns the mean of each column over the rows that define it.
#[expect(clippy::cast_precision_loss, reason = "numbers of scenarios are small")]
pub fn column_means<const M: usize, R: Borrow<[Option<f64>; M]>>(
    rows: impl Iterator<Item = R>,
) -> [ColumnMean; M] {
    let mut sums = [(0.0, 0usize); M];
    for row in rows {
        for (sum, value) in sums.iter_mut().zip(row.borrow()) {
            if let Some(value) = value {
                sum.0 += value;
                sum.1 += 1;
            }
        }
    }
    sums.map(|(sum, count)| ColumnMean { mean: (count > 0).then(|| sum / count as f64), count })
}

/// Returns the quantile of sorted values, interpolated between neighbours; `None` for an empty list.
#[expect(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "an index into a list that fits memory, within its bounds for shares from 0 to 1"
)]
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let position = share * (sorted.len().checked_sub(1)?) as f64;
    let index = position as usize;
    let low = *sorted.get(index)?;
    let high = sorted.get(index + 1).copied().unwrap_or(low);
    Some(low + (position - index as f64) * (high - low))
}

fn generator(seed: u64) -> ChaCha8Rng {
    let mut key = *b"sparring percentile bootstrap 1 ";
    key[..8].copy_from_slice(&seed.to_le_bytes());
    ChaCha8Rng::from_seed(key)
}

/// Draws uniformly from 0..count by the high half of a product; the bias is below count/2⁶⁴.
#[expect(clippy::cast_possible_truncation, reason = "the high half is below count")]
fn draw_below(count: usize, generator: &mut ChaCha8Rng) -> usize {
    ((u128::from(generator.next_u64()) * count as u128) >> 64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 95 % intervals for the mean of 60 uniform draws contain ½ about 95 times in 100. Percentile intervals of 60 values
    /// are about 1 % short, and one standard deviation over 300 repetitions is 1.3 %: the bound is that and four of them.
    #[test]
    fn intervals_cover_the_true_mean() {
        let mut generator = ChaCha8Rng::from_seed([7; 32]);
        let covered = (0..300)
            .filter(|&seed| {
                let rows: Vec<_> = (0..60)
                    .map(|_| [Some(draw_below(1 << 30, &mut generator) as f64 / (1 << 30) as f64)])
                    .collect();
                let [estimate] = estimate_means(&rows, seed);
                estimate.is_some_and(|e| e.low <= 0.5 && 0.5 <= e.high)
            })
            .count();
        assert!((267..=299).contains(&covered), "{covered} of 300");
    }

    /// The bootstrap's spread of the mean of n values is σ/√n, with the standard deviation σ of the values.
    #[test]
    fn interval_width_matches_theory() {
        let rows: Vec<_> = (0..400).map(|i| [Some(f64::from(i % 2))]).collect();
        let [estimate] = estimate_means(&rows, 1);
        let estimate = estimate.unwrap();
        assert_eq!((estimate.mean, estimate.scenarios), (0.5, 400));
        // ±1.96·0.5/√400 = ±0.049; the ends rest on 50 of 2 000 resamples, and on steps of 1/400.
        assert!((estimate.low - 0.451).abs() < 0.006, "{estimate:?}");
        assert!((estimate.high - 0.549).abs() < 0.006, "{estimate:?}");
    }

    /// The exact interval of 0 of 10 ends at 1 − 0.025^(1/10) = 0.3085 (Clopper & Pearson 1934).
    #[test]
    fn share_of_none_or_all_has_an_exact_interval() {
        let of = |mean| with_exact_interval(Estimate { mean, low: mean, high: mean, scenarios: 10 });
        let (none, all) = (of(0.0), of(1.0));
        assert!((none.high - 0.3085).abs() < 5e-5 && none.low == 0.0, "{none:?}");
        assert!((all.low - 0.6915).abs() < 5e-5 && all.high == 1.0, "{all:?}");
        let some = of(0.3);
        assert_eq!((some.low, some.high), (0.3, 0.3), "other shares keep their interval");
    }

    #[test]
    fn means_ignore_undefined_values() {
        let rows = [[Some(1.0), None, None], [Some(2.0), Some(5.0), None], [Some(3.0), Some(7.0), None]];
        let [all, some, none] = estimate_means(&rows, 0);
        assert_eq!(all.map(|e| (e.mean, e.scenarios)), Some((2.0, 3)));
        assert_eq!(some.map(|e| (e.mean, e.low, e.high, e.scenarios)), Some((6.0, 5.0, 7.0, 2)));
        assert_eq!(none, None);
        assert_eq!(estimate_means(&[] as &[[Option<f64>; 1]], 0), [None]);
    }

    #[test]
    fn estimates_depend_on_the_seed_alone() {
        let rows: Vec<_> = (0..50).map(|i| [Some(f64::from(i * i))]).collect();
        assert_eq!(estimate_means(&rows, 3), estimate_means(&rows, 3));
        assert_ne!(estimate_means(&rows, 3), estimate_means(&rows, 4));
    }

    #[test]
    fn quantiles_interpolate() {
        assert_eq!(quantile(&[1.0, 2.0, 3.0], 0.25), Some(1.5));
        assert_eq!(quantile(&[1.0, 2.0, 3.0], 1.0), Some(3.0));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
