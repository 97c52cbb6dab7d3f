//! Curves of runs on one axis, and the mean of several runs with its interval.

use clock::Millis;
use orchestrator::queries::run_series::SeriesPoint;
use statrs::distribution::{ContinuousCDF, StudentsT};
use store::history::HistoryBucket;

use crate::report::chart::Interval;

/// Quantity of the horizontal axis of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(in crate::report) enum FigureAxis {
    /// Episodes of the task.
    Episodes,
    /// Environment steps of the task.
    Steps,
    /// Hours since the start of the run.
    Hours,
}

impl FigureAxis {
    /// Label of the axis.
    pub(super) const fn label(self) -> &'static str {
        match self {
            Self::Episodes => "episodes of the task",
            Self::Steps => "environment steps of the task",
            Self::Hours => "hours since the start",
        }
    }
}

/// Quantity that a figure shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    /// Current level; constant between its moves.
    Level,
    /// Mean rung of the groups with results.
    Rung,
    /// Success rate of all episodes.
    Success,
    /// Mean skill of all episodes.
    Skill,
}

impl Quantity {
    /// All quantities in the order of the figures.
    pub(super) const ALL: [Self; 4] = [Self::Level, Self::Rung, Self::Success, Self::Skill];

    /// Name of the quantity, as in titles.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Level => "Level",
            Self::Rung => "Mean rung",
            Self::Success => "Success rate",
            Self::Skill => "Skill",
        }
    }

    /// Name of the quantity in file names.
    pub(super) const fn slug(self) -> &'static str {
        match self {
            Self::Level => "level",
            Self::Rung => "rung",
            Self::Success => "success",
            Self::Skill => "skill",
        }
    }

    /// Lowest and highest possible value.
    pub(super) const fn bounds(self) -> Interval {
        match self {
            Self::Level | Self::Rung => Interval { low: 0.0, high: f64::INFINITY },
            Self::Success => Interval { low: 0.0, high: 1.0 },
            Self::Skill => Interval { low: f64::NEG_INFINITY, high: f64::INFINITY },
        }
    }

    fn value(self, bucket: &HistoryBucket) -> Option<f64> {
        match self {
            Self::Level => bucket.mastery.and_then(|sample| sample.level).map(|level| level as f64),
            Self::Rung => mean_rung(bucket),
            Self::Success => {
                let ended = bucket.episodes + bucket.failed + bucket.expired;
                ratio(bucket.successes as f64, ended)
            }
            Self::Skill => ratio(bucket.skill_sum, bucket.episodes_with_skill),
        }
    }
}

/// Returns the mean over groups of their start rung, or of their level in tasks without start rungs.
fn mean_rung(bucket: &HistoryBucket) -> Option<f64> {
    let has_starts = bucket.rungs.keys().any(|key| key.start_rung.is_some());
    let (mut sum, mut groups) = (0, 0);
    for (key, results) in &bucket.rungs {
        if let Some(rung) = if has_starts { key.start_rung } else { key.level } {
            sum += rung * results.groups;
            groups += results.groups;
        }
    }
    ratio(sum as f64, groups)
}

fn ratio(sum: f64, n: i64) -> Option<f64> {
    (n > 0).then(|| sum / n as f64)
}

/// Curve of one run.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Line {
    /// Positions in ascending order, with their values.
    pub(super) points: Vec<(f64, f64)>,
    /// True if a value holds until the next position.
    pub(super) is_stepped: bool,
}

impl Line {
    /// Returns the value at the end: the mean of the last tenth of the points, or the last value of steps.
    pub(super) fn final_value(&self) -> Option<f64> {
        let n = if self.is_stepped { 1 } else { self.points.len().div_ceil(10) };
        let last = &self.points[self.points.len().saturating_sub(n)..];
        ratio(last.iter().map(|(_, value)| value).sum(), last.len() as i64)
    }

    /// Returns the value at each position; none before the first point and after the last one.
    pub(super) fn resample(&self, grid: &[f64]) -> Vec<Option<f64>> {
        let reach = grid.get(1).map_or(0.0, |second| (second - grid[0]) / 2.0);
        let (Some(first), Some(last)) = (self.points.first(), self.points.last()) else {
            return vec![None; grid.len()];
        };
        let value = |at: f64| {
            let next = self.points.partition_point(|(x, _)| *x <= at);
            let (a, low) = self.points[next.saturating_sub(1)];
            let (b, high) = self.points[next.min(self.points.len() - 1)];
            if self.is_stepped || b <= a {
                low
            } else {
                low + ((at - a) / (b - a)).clamp(0.0, 1.0) * (high - low)
            }
        };
        let is_inside = |at: f64| at >= first.0 - reach && at <= last.0 + reach;
        grid.iter().map(|at| is_inside(*at).then(|| value(*at))).collect()
    }
}

/// Returns the curve of a quantity of a run.
pub(super) fn line(quantity: Quantity, points: &[SeriesPoint], axis: FigureAxis, start: Millis) -> Line {
    let is_stepped = quantity == Quantity::Level;
    let at = |point: &SeriesPoint| {
        let (from, to) = span(point, axis, start)?;
        // The level at the end of a point holds until the end of the next one.
        Some(if is_stepped { to } else { from.midpoint(to) })
    };
    let points = points.iter().filter_map(|point| Some((at(point)?, quantity.value(&point.bucket)?)));
    Line { points: points.collect(), is_stepped }
}

fn span(point: &SeriesPoint, axis: FigureAxis, start: Millis) -> Option<(f64, f64)> {
    let place = point.position;
    let counts = |first: i64, n: i64| (first as f64, (first + n) as f64);
    let hours = |at: Millis| (at - start) as f64 / 3_600_000.0;
    Some(match axis {
        FigureAxis::Hours => (hours(point.from), hours(point.to)),
        FigureAxis::Episodes => {
            counts(place?.first_episode, point.bucket.episodes + point.bucket.claimed_episodes)
        }
        FigureAxis::Steps => counts(place?.first_step, point.bucket.steps),
    })
}

/// Mean of several values with an interval around it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct MeanBand {
    /// Mean of the values.
    pub(super) mean: f64,
    /// 95 % interval of the mean by Student's t; of two values, from one to the other.
    pub(super) interval: Interval,
}

/// Returns the mean of the values with its interval within the bounds; none without values.
pub(super) fn mean_band(values: &[f64], bounds: Interval) -> Option<MeanBand> {
    let n = values.len();
    let mean = ratio(values.iter().sum(), n as i64)?;
    if n < 3 {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        return Some(MeanBand { mean, interval: Interval { low, high } });
    }
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
    let t = StudentsT::new(0.0, 1.0, (n - 1) as f64).map_or(f64::NAN, |of| of.inverse_cdf(0.975));
    let half = t * (variance / n as f64).sqrt();
    let interval = Interval { low: (mean - half).max(bounds.low), high: (mean + half).min(bounds.high) };
    Some(MeanBand { mean, interval })
}

/// Returns the mean of several runs at each position where all of them have a value.
pub(super) fn mean_curve(lines: &[&Line], grid: &[f64], bounds: Interval) -> Vec<Option<MeanBand>> {
    let resampled: Vec<_> = lines.iter().map(|line| line.resample(grid)).collect();
    let at = |i: usize| {
        let values: Option<Vec<f64>> = resampled.iter().map(|values| values[i]).collect();
        mean_band(&values?, bounds)
    };
    (0..grid.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FREE: Interval = Quantity::Skill.bounds();

    fn plain(points: &[(f64, f64)]) -> Line {
        Line { points: points.to_vec(), is_stepped: false }
    }

    #[test]
    fn values_lie_between_the_points_only() {
        let grid = [0.0, 5.0, 10.0, 15.0, 20.0, 25.0];
        let line = plain(&[(10.0, 0.0), (20.0, 1.0)]);
        assert_eq!(line.resample(&grid), [None, None, Some(0.0), Some(0.5), Some(1.0), None]);
        let steps = Line { is_stepped: true, ..line };
        assert_eq!(steps.resample(&grid), [None, None, Some(0.0), Some(0.0), Some(1.0), None]);
        assert_eq!(plain(&[]).resample(&[1.0]), [None]);
    }

    #[test]
    fn mean_ends_with_the_shortest_run() {
        let (short, long) = (plain(&[(0.0, 0.0), (10.0, 10.0)]), plain(&[(0.0, 2.0), (20.0, 22.0)]));
        let curve = mean_curve(&[&short, &long], &[0.0, 5.0, 10.0, 15.0], FREE);
        let means: Vec<_> = curve.iter().map(|at| at.map(|band| band.mean)).collect();
        assert_eq!(means, [Some(1.0), Some(6.0), Some(11.0), None]);
        assert_eq!(curve[1].map(|band| band.interval), Some(Interval { low: 5.0, high: 7.0 }));
    }

    #[test]
    fn interval_of_ten_values() {
        let values: Vec<f64> = (1..=10).map(f64::from).collect();
        let band = mean_band(&values, FREE).unwrap();
        assert!(
            (band.interval.low - 3.334).abs() < 1e-3 && (band.interval.high - 7.666).abs() < 1e-3,
            "{band:?}"
        );
        let bounded = mean_band(&[0.0, 0.5, 1.0], Quantity::Success.bounds()).unwrap();
        assert_eq!(bounded.interval, Interval { low: 0.0, high: 1.0 });
        assert_eq!(mean_band(&[], FREE), None);
    }

    #[test]
    fn final_value_is_the_mean_of_the_last_tenth() {
        let line = plain(&(0..20).map(|i| (f64::from(i), f64::from(i))).collect::<Vec<_>>());
        assert_eq!(line.final_value(), Some(18.5));
        assert_eq!(Line { is_stepped: true, ..line }.final_value(), Some(19.0));
        assert_eq!(plain(&[]).final_value(), None);
    }
}
