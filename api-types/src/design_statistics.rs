//! Statistics of a run's designs.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::DesignerKind;

/// Numbers of designs of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct DesignStatistics {
    /// Id of the run.
    pub run: String,
    /// Design settings of the run.
    #[schema(value_type = Object)]
    pub settings: Value,
    /// Number of groups leased for training.
    pub train_groups: i64,
    /// Number of designed groups among them.
    pub designed_groups: i64,
    /// designed_groups / train_groups; null before the first group.
    pub share: Option<f64>,
    /// Probability that the next training group is designed, if a layout suits it, from 0 to the setting `share`.
    pub next_share: f64,
    /// Learning signal of designed groups.
    pub designed_signal: LearningSignal,
    /// Learning signal of the other groups.
    pub ordinary_signal: LearningSignal,
    /// Numbers of designs by task.
    pub tasks: Vec<TaskDesigns>,
    /// Requests and cost by designer.
    pub designers: Vec<DesignerUsage>,
    /// Health of the server's language model for designs; null if it has none. A worker's own model is not shown.
    #[schema(value_type = Option<Object>)]
    pub llm: Option<Value>,
}

/// Learning signal of groups of one kind: the variance of success within a group, averaged over groups. The latest groups weigh
/// most, and without groups it is a prior.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct LearningSignal {
    /// Number of groups, which fade: a group counts half after 256 groups of the run.
    pub groups: f64,
    /// Mean variance, 0 to 0.5.
    pub mean: f64,
    /// Standard error of the mean.
    pub standard_error: f64,
}

/// Numbers of designs of a task.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TaskDesigns {
    /// Id of the task.
    pub task: String,
    /// Number of active layouts.
    pub active: i64,
    /// Numbers of retired layouts by reason: `mastered`, `hopeless`, `user`, `wrong`.
    pub retired: BTreeMap<String, i64>,
    /// Number of admitted designs.
    pub admitted: i64,
    /// Numbers of refused designs by check of the gate, in the order of the checks, including designs that are not kept.
    pub refused: Vec<GateCheckCount>,
}

/// Number of designs that failed one check of the gate.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct GateCheckCount {
    /// Name of the check.
    pub check: String,
    /// Description of the check.
    pub description: String,
    /// Number of refused designs.
    pub count: i64,
}

/// Requests to a designer and their cost.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct DesignerUsage {
    /// Designer that the requests are for.
    pub designer: DesignerKind,
    /// Number of requests to the designer.
    pub requests: i64,
    /// Number of failed requests.
    pub failed: i64,
    /// Number of prompt tokens.
    pub tokens_in: i64,
    /// Number of completion tokens.
    pub tokens_out: i64,
    /// Cost of the tokens, in the currency of the configured prices.
    pub cost: f64,
}
