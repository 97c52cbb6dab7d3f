//! Estimates of evaluations and their comparisons.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Part of a suite that results are about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SuiteSection {
    /// Contested scenarios, on which acting well matters.
    Contested,
    /// Scenarios drawn without a condition.
    AsTheyCome,
    /// All scenarios of the suite.
    All,
}

impl SuiteSection {
    /// Name of the part, as in JSON.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Contested => "contested",
            Self::AsTheyCome => "as_they_come",
            Self::All => "all",
        }
    }

    /// Label of the part in tables and pictures.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Contested => "contested",
            Self::AsTheyCome => "unfiltered",
            Self::All => "all",
        }
    }
}

/// Estimates for one policy on one part of one task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct EvaluationEstimates {
    /// Id of the task, or `all`.
    pub task: String,
    /// Part of the suite: `contested`, `as_they_come` or `all`.
    pub part: SuiteSection,
    /// Name of the policy.
    pub policy: String,
    /// Number of scenarios in the section.
    pub scenarios: usize,
    /// Score of the world.
    pub score: Option<Estimate>,
    /// Share of successful episodes.
    pub success: Option<Estimate>,
    /// Skill on the scenarios that define it.
    pub skill: Option<Estimate>,
    /// Share of agents lost.
    pub lost: Option<Estimate>,
    /// Fuel used by all agents together.
    pub fuel_used: Option<Estimate>,
    /// Mean score over the worst tenth of the scenarios (conditional value at risk).
    pub cvar10: Option<Estimate>,
}

/// Mean over scenarios with its 95 % bootstrap interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Estimate {
    /// Mean or another statistic.
    pub mean: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
    /// Number of scenarios that define the quantity.
    pub scenarios: usize,
}

/// Comparison of two sides, each with one or more evaluations.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Comparison {
    /// Suite of all evaluations.
    pub suite: String,
    /// First side of the comparison.
    pub a: ComparisonSide,
    /// Second side of the comparison.
    pub b: ComparisonSide,
    /// Differences of the first side to the second on the same scenarios, over all trainings of a side. There is one row for each task
    /// and part of the suite.
    pub rows: Vec<ComparisonEstimates>,
}

/// Side of a comparison.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ComparisonSide {
    /// Ids of its evaluations.
    pub evaluations: Vec<String>,
    /// Interquartile means over its trainings; null below three trainings.
    pub across: AcrossSeeds,
}

/// Comparison of two policies on one part of one task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ComparisonEstimates {
    /// Id of the task, or `all`.
    pub task: String,
    /// Part of the suite: `contested`, `as_they_come` or `all`.
    pub part: SuiteSection,
    /// Name of the policy.
    pub policy: String,
    /// Number of scenarios in the section.
    pub scenarios: usize,
    /// Differences to the other policy.
    #[serde(flatten)]
    pub comparison: PolicyComparison,
}

/// Comparison of one policy with another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PolicyComparison {
    /// Mean over scenarios of the difference of scores.
    pub score: Option<Estimate>,
    /// Mean over scenarios of the difference of success.
    pub success: Option<Estimate>,
    /// Mean of the difference of skill over the scenarios that define it.
    pub skill: Option<Estimate>,
    /// Probability that an episode of the first policy has the higher score on the same scenario, with ties as one half:
    /// the mean over scenarios (probability of improvement, Agarwal et al. 2021, over scenarios instead of tasks).
    pub improvement: Option<Estimate>,
}

/// Estimates over trainings that differ by their seed, with intervals over trainings. The field `scenarios` of an estimate has the number
/// of trainings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AcrossSeeds {
    /// Number of trainings in the estimate.
    pub trainings: usize,
    /// Interquartile mean of the trainings' mean scores.
    pub score: Option<Estimate>,
    /// Interquartile mean of the trainings' shares of success.
    pub success: Option<Estimate>,
    /// Interquartile mean of the trainings' mean skill.
    pub skill: Option<Estimate>,
}
