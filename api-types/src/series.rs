//! Time series of a run.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// Query of the time series.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct SeriesQuery {
    /// Start of the window, RFC 3339 (default: start of the run).
    #[param(example = "2026-01-01T00:00:00Z")]
    pub from: Option<String>,
    /// End of the window, RFC 3339 (default: now).
    pub to: Option<String>,
    /// Largest number of points of each series, from 1 to 2 000 (default 300).
    #[param(minimum = 1, maximum = 2000, default = 300)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 2000>")]
    pub points: Option<u32>,
}

/// Time series of a run in a window.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunSeries {
    /// Start of the window, RFC 3339.
    pub from: String,
    /// End of the window, RFC 3339.
    pub to: String,
    /// Width of a point, seconds: a multiple of 60, or of 3 600 if the window starts earlier than a week ago or a point is longer than
    /// an hour.
    pub width_s: i64,
    /// Tasks with results in the window.
    pub tasks: Vec<TaskSeries>,
}

/// Time series of a task: columns of equal length, null where there is no value.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
pub struct TaskSeries {
    /// Id of the task.
    pub task: String,
    /// Start of each point, Unix time in seconds.
    pub at: Vec<i64>,
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
