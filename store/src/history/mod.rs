//! History of runs: results by task and time, in buckets of a minute (kept for a week) and of an hour (kept for ever). Tables
//! `task_history`, `task_history_params` and `task_history_rungs`.
//!
//! [`write`] adds results to the buckets, [`read`] reads a window of time as a limited number of points, and [`rungs`] has the
//! results by start rung and level. [`curves`] has the same results by episodes instead of by time.

mod curve_point;
mod curve_rows;
mod curves;
mod read;
mod rungs;
mod write;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::Millis;
use crate::task_counters::TaskCounters;

pub use self::curve_point::CurvePoint;
pub use self::curves::{ActiveSpan, PAUSE, active_span, learning_curves, thin_curve};
pub(crate) use self::read::tasks;
pub use self::read::{HistoryPoint, HistoryWindow, curve};
pub use self::rungs::{RungKey, RungPoint, RungResults, rung_points};
pub use self::write::{add, delete_old_minutes};

/// Milliseconds of a minute, the width of a fine bucket.
pub const MINUTE: Millis = 60_000;
/// Milliseconds of an hour, the width of a coarse bucket.
pub const HOUR: Millis = 60 * MINUTE;
/// Time for which buckets of a minute are kept, milliseconds.
pub const MINUTES_KEPT: Millis = 7 * 24 * HOUR;

/// Results of a task in a bucket, or a part of them. Its JSON has no zeros and no empty fields.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct HistoryBucket {
    /// Number of finished episodes.
    #[serde(skip_serializing_if = "is_default")]
    pub episodes: i64,
    /// Finished episodes that succeeded.
    #[serde(skip_serializing_if = "is_default")]
    pub successes: i64,
    /// Sum of the scores of finished episodes.
    #[serde(skip_serializing_if = "is_default")]
    pub score_sum: f64,
    /// Finished episodes that have a skill.
    #[serde(skip_serializing_if = "is_default")]
    pub episodes_with_skill: i64,
    /// Sum of their skills.
    #[serde(skip_serializing_if = "is_default")]
    pub skill_sum: f64,
    /// Number of failed episodes.
    #[serde(skip_serializing_if = "is_default")]
    pub failed: i64,
    /// Episodes whose lease ended before they were reported.
    #[serde(skip_serializing_if = "is_default")]
    pub expired: i64,
    /// Contested groups that are evidence.
    #[serde(skip_serializing_if = "is_default")]
    pub contested_groups: i64,
    /// Sum of their success rates.
    #[serde(skip_serializing_if = "is_default")]
    pub success_rate_sum: f64,
    /// Contested groups whose blind panel was replayed: a sample.
    #[serde(skip_serializing_if = "is_default")]
    pub panel_groups: i64,
    /// Sum of the success rates of the blind plans on these.
    #[serde(skip_serializing_if = "is_default")]
    pub panel_success_rate_sum: f64,
    /// Groups of several episodes that counted.
    #[serde(skip_serializing_if = "is_default")]
    pub groups: i64,
    /// Groups among these whose episodes all have the same score.
    #[serde(skip_serializing_if = "is_default")]
    pub zero_variance_groups: i64,
    /// Episodes of accepted claims.
    #[serde(skip_serializing_if = "is_default")]
    pub claimed_episodes: i64,
    /// Durations of finished episodes whose steps differ in duration.
    #[serde(skip_serializing_if = "is_default")]
    pub durations: DurationSum,
    /// Environment steps of finished episodes. [`curve`] leaves them out.
    #[serde(skip_serializing_if = "is_default")]
    pub steps: i64,
    /// Policy versions of finished episodes. [`curve`] leaves them out.
    #[serde(skip_serializing_if = "is_default")]
    pub versions: Option<VersionRange>,
    /// Lowest level that occurred.
    #[serde(skip_serializing_if = "is_default")]
    pub lowest_level: Option<i64>,
    /// Highest level that occurred.
    #[serde(skip_serializing_if = "is_default")]
    pub highest_level: Option<i64>,
    /// Latest mastery estimate in the bucket.
    #[serde(skip_serializing_if = "is_default")]
    pub mastery: Option<MasterySample>,
    /// Parameters of the scenarios, by name.
    #[serde(skip_serializing_if = "is_default")]
    pub params: BTreeMap<String, ParamRange>,
    /// Results by start rung and level. [`curve`] leaves them out.
    #[serde(with = "rungs::as_list", skip_serializing_if = "is_default")]
    pub rungs: BTreeMap<RungKey, RungResults>,
}

/// True for a value that a bucket does not store: reading restores it.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Policy versions of episodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct VersionRange {
    /// Lowest version of the episodes.
    pub low: i64,
    /// Highest version of the episodes.
    pub high: i64,
}

impl VersionRange {
    /// Range of one version.
    #[must_use]
    pub const fn of(version: i64) -> Self {
        Self { low: version, high: version }
    }

    /// Range of the versions of both.
    #[must_use]
    pub fn joined_with(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

/// Sum of the durations of episodes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct DurationSum {
    /// Number of episodes with a duration.
    pub episodes: i64,
    /// Sum of their durations, s.
    pub seconds: f64,
}

impl DurationSum {
    /// Adds the duration of an episode, s.
    pub fn add(&mut self, seconds: f64) {
        self.join(Self { episodes: 1, seconds });
    }

    /// Adds the durations of other episodes.
    pub fn join(&mut self, other: Self) {
        self.episodes += other.episodes;
        self.seconds += other.seconds;
    }
}

/// Mastery estimate of a task at one moment: the posterior over success on contested scenarios of its level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MasterySample {
    /// Level of the task; none for strategies without levels.
    pub level: Option<i64>,
    /// Mean of the posterior.
    pub mean: f64,
    /// 10 % quantile of the posterior.
    pub q10: f64,
    /// 90 % quantile of the posterior.
    pub q90: f64,
}

/// Values that a parameter had.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ParamRange {
    /// Number of the values.
    pub n: i64,
    /// Sum of the values.
    pub total: f64,
    /// Lowest of the values.
    pub low: f64,
    /// Highest of the values.
    pub high: f64,
}

/// Value of a scenario's parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParamValue<'a> {
    /// Name of the parameter.
    pub name: &'a str,
    /// Value of the param.
    pub value: f64,
}

impl HistoryBucket {
    /// Counts episodes that were flown at a level.
    pub fn add(&mut self, sums: &TaskCounters, level: Option<i64>) {
        self.episodes += sums.episodes;
        self.successes += sums.successes;
        self.score_sum += sums.score_sum;
        self.episodes_with_skill += sums.episodes_with_skill;
        self.skill_sum += sums.skill_sum;
        self.failed += sums.failed;
        self.expired += sums.expired;
        // Expired episodes alone do not extend the range of levels that were reported.
        if sums.episodes + sums.failed > 0 {
            self.add_level(level);
        }
    }

    /// Adds a later part of the same bucket.
    pub fn join(&mut self, later: &Self) {
        self.episodes += later.episodes;
        self.successes += later.successes;
        self.score_sum += later.score_sum;
        self.episodes_with_skill += later.episodes_with_skill;
        self.skill_sum += later.skill_sum;
        self.failed += later.failed;
        self.expired += later.expired;
        self.contested_groups += later.contested_groups;
        self.success_rate_sum += later.success_rate_sum;
        self.panel_groups += later.panel_groups;
        self.panel_success_rate_sum += later.panel_success_rate_sum;
        self.groups += later.groups;
        self.zero_variance_groups += later.zero_variance_groups;
        self.claimed_episodes += later.claimed_episodes;
        self.durations.join(later.durations);
        self.steps += later.steps;
        self.add_versions(later.versions);
        self.lowest_level = self.lowest_level.into_iter().chain(later.lowest_level).min();
        self.highest_level = self.highest_level.max(later.highest_level);
        self.mastery = later.mastery.or(self.mastery);
        for (name, range) in &later.params {
            self.params.entry(name.clone()).and_modify(|known| known.join(range)).or_insert(*range);
        }
        for (key, results) in &later.rungs {
            self.add_rung(*key, *results);
        }
    }

    /// Adds results at a rung.
    pub fn add_rung(&mut self, key: RungKey, results: RungResults) {
        self.rungs.entry(key).or_default().join(results);
    }

    /// Adds the parameters of a scenario.
    pub fn add_params<'a>(&mut self, params: impl IntoIterator<Item = ParamValue<'a>>) {
        for ParamValue { name, value } in params {
            let range = ParamRange::of(value);
            self.params.entry(name.to_owned()).and_modify(|known| known.join(&range)).or_insert(range);
        }
    }

    /// Extends the range of policy versions.
    pub fn add_versions(&mut self, versions: Option<VersionRange>) {
        self.versions = match (self.versions, versions) {
            (Some(known), Some(other)) => Some(known.joined_with(other)),
            (known, other) => known.or(other),
        };
    }

    /// True if the bucket has episodes or groups, and not only a sample of mastery.
    #[must_use]
    pub fn has_results(&self) -> bool {
        let Self { episodes, failed, expired, claimed_episodes, groups, contested_groups, .. } = self;
        [episodes, failed, expired, claimed_episodes, groups, contested_groups].iter().any(|n| **n > 0)
            || !self.rungs.is_empty()
    }

    /// Extends the range of levels by one level.
    pub fn add_level(&mut self, level: Option<i64>) {
        self.lowest_level = self.lowest_level.into_iter().chain(level).min();
        self.highest_level = self.highest_level.max(level);
    }
}

impl ParamRange {
    /// Range of one value.
    #[must_use]
    pub const fn of(value: f64) -> Self {
        Self { n: 1, total: value, low: value, high: value }
    }

    /// Adds the values of another range.
    pub const fn join(&mut self, other: &Self) {
        self.n += other.n;
        self.total += other.total;
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }
}
