//! Evaluations on frozen suites.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use crate::{EvaluationEstimates, MissingShard, SuiteSection};

/// Evaluation without its results.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EvaluationSummary {
    /// Id of the evaluation.
    pub id: String,
    /// Name of the evaluation for people.
    pub name: String,
    /// Name of the suite.
    pub suite: String,
    /// Hash of the suite: evaluations with the same hash are comparable.
    pub suite_hash: String,
    /// Tasks of the suite that are evaluated; null for all.
    pub tasks: Option<Vec<String>>,
    /// Name of the policy.
    pub policy: String,
    /// Run whose trainer runs the episodes; null if the server does.
    pub run: Option<String>,
    /// Version of the run's policy.
    pub policy_version: Option<i64>,
    /// Common name of trainings that differ by their seed.
    pub training: Option<String>,
    /// Seed of the training that the evaluation is about.
    pub training_seed: Option<i64>,
    /// Number of episodes of each scenario.
    pub rollouts: i64,
    /// True if the episodes of a scenario differ by chance.
    pub stochastic: bool,
    /// State of the evaluation.
    pub state: EvaluationState,
    /// Reason of a failure.
    pub error: Option<String>,
    /// Number of scenarios of the evaluation.
    pub scenarios: i64,
    /// Number of scenarios that are done.
    pub scenarios_done: i64,
    /// Number of groups that were leased again, because they lost episodes or their lease ended. Results of such groups do not
    /// count. A high number can bias the results: low scores may be lost more often than high ones.
    pub retries: i64,
    /// Time of creation, RFC 3339.
    pub created_at: String,
    /// Time at which the last scenario was done, RFC 3339.
    pub completed_at: Option<String>,
}

/// Page of the list of evaluations.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EvaluationPage {
    /// Evaluations of the page, newest first.
    pub evaluations: Vec<EvaluationSummary>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
    /// Shards whose evaluations the page lacks; empty for a server without peers.
    #[serde(default)]
    #[schema(required = true)]
    pub missing_shards: Vec<MissingShard>,
}

/// Query of a comparison.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct ComparisonQuery {
    /// Ids of evaluations, separated by commas: trainings that differ by their seed.
    #[param(example = "eval-1,eval-2")]
    pub a: String,
    /// Ids of the evaluations to compare them with.
    #[param(example = "eval-3")]
    pub b: String,
}

/// Page of the scenarios of an evaluation.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EvaluationScenarioPage {
    /// Scenarios, in the order of the suite.
    pub scenarios: Vec<EvaluationScenario>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Results of a policy on one scenario.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EvaluationScenario {
    /// Index of the scenario in the suite, the same in all evaluations of the suite.
    pub index: i64,
    /// Id of the scenario.
    pub scenario_id: String,
    /// Id of the task.
    pub task: String,
    /// Level at which the scenario was drawn.
    pub level: usize,
    /// Part of the suite: `contested` or `as_they_come`.
    pub part: SuiteSection,
    /// Score without acting on observations: mean score of the blind panel in `kessler/survival` and `kessler/eco_station`,
    /// best score of the blind panel in `tasking`, but at least 0, and score of `hold` in other tasks.
    pub floor: f64,
    /// Score of the reference planner.
    pub reference: f64,
    /// Number of finished episodes.
    pub episodes: usize,
    /// Id of the first of them in the run of the evaluation, whose replay can be read; null if the server ran the scenario.
    pub first_episode: Option<String>,
    /// Mean score of the episodes.
    pub score: Option<f64>,
    /// Success rate of the episodes.
    pub success: Option<f64>,
    /// Mean skill, if the scenario defines one.
    pub skill: Option<f64>,
    /// Share of agents lost.
    pub lost: Option<f64>,
    /// Mean fuel spent by all agents together.
    pub fuel_used: Option<f64>,
}

/// Request to start an evaluation.
#[derive(Debug, Clone, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct EvaluationRequest {
    /// Name of a built-in suite (default `kessler-heldout-v2`).
    #[schema(example = "kessler-heldout-v2")]
    pub suite: Option<String>,
    /// Tasks whose scenarios are evaluated (default: all). It needs `run`: the server evaluates whole suites.
    #[schema(example = json!(["docking/single"]))]
    pub tasks: Option<Vec<String>>,
    /// Without `run`: a built-in policy that every task of the suite has, or a file in the policy folder of the server, such as
    /// `onnx:model.onnx`; the server rolls it out. The evaluation shows a file with the hash of its contents. With `run`: any name.
    #[schema(example = "heuristic")]
    pub policy: String,
    /// Run whose trainer rolls the policy out, in leases with `purpose: eval` and the id of the evaluation.
    pub run: Option<String>,
    /// Version of the run's policy (default: the newest).
    pub policy_version: Option<u32>,
    /// Common name of trainings that differ only by their seed.
    pub training: Option<String>,
    /// Seed of the training that the evaluation is about.
    pub training_seed: Option<u32>,
    /// Number of episodes of each scenario, from 1 to 1 024 (default 1; 8 if the policy is stochastic).
    #[schema(minimum = 1, maximum = 1024)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 1024>")]
    pub rollouts: Option<u32>,
    /// True if the policy is stochastic (default true; not allowed for a built-in policy).
    pub stochastic: Option<bool>,
    /// Seed of a stochastic built-in policy (default 0).
    pub seed: Option<u32>,
    /// Name of the evaluation for people (default: the name of the policy).
    pub name: Option<String>,
}

/// Evaluation with its results.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Evaluation {
    /// The evaluation, as lists show it.
    #[serde(flatten)]
    pub summary: EvaluationSummary,
    /// Results of a complete evaluation and of the blind panel (policy `blind_panel`), one row for each task and part of the suite. Empty
    /// until the evaluation is complete.
    pub rows: Vec<EvaluationEstimates>,
}

/// State of an evaluation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EvaluationState {
    /// A trainer leases and runs the scenarios.
    Open,
    /// The server runs the scenarios.
    Running,
    /// All scenarios were run.
    Complete,
    /// The evaluation was cancelled, or its policy cannot run.
    Failed,
}
