//! Numbers that a trainer logs about its training.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// Metrics of a trainer at one of its steps.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct TrainerMetricsRequest {
    /// Step of the trainer, such as its number of environment steps or updates, from 0 to 2^53 − 1.
    #[schema(minimum = 0, maximum = 9_007_199_254_740_991_i64, example = 20480)]
    #[serde(deserialize_with = "crate::integers::trainer_step")]
    pub step: u64,
    /// Values by name, 1 to 100; null for a number that is not finite. A name has 1 to 128 of a-z, A-Z, 0-9, _, ., :, / and -, and
    /// begins with a letter or a digit.
    #[schema(example = json!({"train/loss": 0.31, "train/approx_kl": 0.012}))]
    pub metrics: BTreeMap<String, Option<f64>>,
}

/// Receipt of a trainer's metrics.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TrainerMetricsReceipt {
    /// Step of the metrics.
    pub step: u64,
    /// Number of values that were stored.
    pub stored: usize,
    /// Number of metrics of the run.
    pub metrics: i64,
}

/// Query of a trainer's metrics.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct TrainerMetricsQuery {
    /// Name of the only metric to return (default: all).
    pub name: Option<String>,
    /// Start of the window, RFC 3339 (default: start of the run).
    #[param(example = "2026-01-01T00:00:00Z")]
    pub from: Option<String>,
    /// End of the window, RFC 3339 (default: now).
    pub to: Option<String>,
    /// Largest number of points of each metric, from 1 to 2 000 (default 300).
    #[param(minimum = 1, maximum = 2000, default = 300)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 2000>")]
    pub points: Option<u32>,
}

/// Metrics of a run's trainer in a window.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TrainerMetrics {
    /// Metrics with points in the window, in alphabetical order.
    pub metrics: Vec<TrainerMetric>,
}

/// Metric of a trainer: columns of equal length, in the order of steps. A point covers one report or several successive ones.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
pub struct TrainerMetric {
    /// Name of the metric.
    pub name: String,
    /// Last step of each point.
    pub step: Vec<i64>,
    /// Time of the last report of each point, Unix time in seconds.
    pub at: Vec<f64>,
    /// Mean value of each point; null if no value is finite.
    pub value: Vec<Option<f64>>,
    /// Value of the newest step of the last point; null if it is not finite.
    pub last_value: Option<f64>,
}
