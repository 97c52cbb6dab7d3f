//! Time series of a run.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// Query of the series of a run.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct SeriesQuery {
    /// Quantity that the points divide: `time` (default) or the `episodes` of each task.
    #[param(inline)]
    pub by: Option<SeriesAxis>,
    /// Start of the window of time, RFC 3339 (default: start of the run). Not with `by=episodes`.
    #[param(example = "2026-01-01T00:00:00Z")]
    pub from: Option<String>,
    /// End of the window of time, RFC 3339 (default: now). Not with `by=episodes`.
    pub to: Option<String>,
    /// Number of a task's episodes before the first point (default 0). Only with `by=episodes`.
    #[param(minimum = 0)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 0, { u32::MAX }>")]
    pub from_episode: Option<u32>,
    /// Number of a task's episodes at the end of the last point (default: all). Only with `by=episodes`.
    #[param(minimum = 0)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 0, { u32::MAX }>")]
    pub to_episode: Option<u32>,
    /// Largest number of points of each series, from 1 to 2 000 (default 300).
    #[param(minimum = 1, maximum = 2000, default = 300)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 2000>")]
    pub points: Option<u32>,
}

/// Quantity that the points of a series divide.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SeriesAxis {
    /// Time of the results.
    #[default]
    Time,
    /// Episodes of a task.
    Episodes,
}

/// Part of a series that a point covers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SeriesResolution {
    /// Consecutive episodes of a task.
    Episodes,
    /// An interval of whole minutes.
    Minutes,
    /// An interval of whole hours.
    Hours,
}

/// Series of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunSeries {
    /// Start of the window, RFC 3339.
    pub from: String,
    /// End of the window, RFC 3339.
    pub to: String,
    /// Part that a point covers. Over time, points are intervals of whole minutes, or of hours if the window starts earlier than a week ago or a
    /// point is longer than an hour. Windows in which these would be few have points of consecutive episodes.
    pub resolution: SeriesResolution,
    /// Tasks with results in the window.
    pub tasks: Vec<TaskSeries>,
}

/// Series of a task: columns of equal length, null where there is no value. A gap without results has an empty point at its start and
/// at its end.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
pub struct TaskSeries {
    /// Id of the task.
    pub task: String,
    /// Start of each point, Unix time in seconds.
    pub at: Vec<f64>,
    /// End of each point, Unix time in seconds.
    pub until: Vec<f64>,
    /// Number of the task's episodes before each point; null if points are minutes or hours. Episodes are finished ones, and those of
    /// accepted claims of columns.
    pub first_episode: Vec<Option<i64>>,
    /// Number of the environment steps of these episodes; null if points are minutes or hours. Claims of columns do not have them: each
    /// of their episodes counts as many as the audited ones had on average.
    pub first_step: Vec<Option<i64>>,
    /// Number of environment steps in each point; null if points are minutes or hours.
    pub steps: Vec<Option<i64>>,
    /// Lowest policy version of the episodes; null if points are minutes or hours.
    pub version_low: Vec<Option<i64>>,
    /// Highest policy version of the episodes; null if points are minutes or hours.
    pub version_high: Vec<Option<i64>>,
    /// Number of finished episodes.
    pub episodes: Vec<i64>,
    /// Number of episodes of accepted claims of columns.
    pub claimed: Vec<i64>,
    /// Number of failed and expired episodes.
    pub lost: Vec<i64>,
    /// Success rate of all episodes, missing ones counted as failures.
    pub success: Vec<Option<f64>>,
    /// Mean score of all episodes.
    pub score: Vec<Option<f64>>,
    /// Mean duration of finished episodes in worlds whose steps differ in duration, s.
    pub duration_s: Vec<Option<f64>>,
    /// Mean skill, over scenarios that define one.
    pub skill: Vec<Option<f64>>,
    /// Mean success rate on slots: contested scenarios that are evidence, missing episodes counted as failures.
    pub contested_success: Vec<Option<f64>>,
    /// Number of contested scenarios with results.
    pub contested_scenarios: Vec<i64>,
    /// Mean success rate of the blind panel on those contested scenarios whose panel was computed.
    pub panel_success: Vec<Option<f64>>,
    /// Share of the groups of several episodes whose episodes all have the same score.
    pub zero_variance_share: Vec<Option<f64>>,
    /// Lowest level of the results.
    pub level_low: Vec<Option<i64>>,
    /// Highest level of the results.
    pub level_high: Vec<Option<i64>>,
    /// Current level at the end of the point.
    pub level: Vec<Option<i64>>,
    /// Mean of the posterior of success on contested scenarios at the current level, at the end of the point.
    pub mastery: Vec<Option<f64>>,
    /// 10 % quantile of the posterior.
    pub mastery_low: Vec<Option<f64>>,
    /// 90 % quantile of the posterior.
    pub mastery_high: Vec<Option<f64>>,
    /// Params of the results, by name.
    pub params: BTreeMap<String, ParamSeries>,
}

/// Time series of a param.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
pub struct ParamSeries {
    /// Mean value of each point.
    pub mean: Vec<Option<f64>>,
    /// Lowest value of each point.
    pub low: Vec<Option<f64>>,
    /// Highest value of each point.
    pub high: Vec<Option<f64>>,
}
