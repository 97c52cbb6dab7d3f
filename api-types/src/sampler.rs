//! Samplers of a run: where each task draws its scenarios, and the success there.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::SeriesResolution;

/// Samplers of all tasks of a run, with the course of their draws in a window.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunSampler {
    /// Strategy of the run.
    pub strategy: String,
    /// Start of the window, RFC 3339.
    pub from: String,
    /// End of the window, RFC 3339.
    pub to: String,
    /// Part that a point of the course covers, as in the series of the run.
    pub resolution: SeriesResolution,
    /// One entry for each task of the run.
    pub tasks: Vec<TaskSampler>,
}

/// Sampler of a task.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct TaskSampler {
    /// Id of the task.
    pub task: String,
    /// Name of the sampler: the strategy, or the sampler that `auto` chose for the task.
    pub name: String,
    /// Reason of the choice, as the end of a sentence; null unless the strategy is `auto`.
    pub reason: Option<String>,
    /// State of the sampler in one sentence.
    pub state: String,
    /// Kind of the rungs; null if the strategy draws params, which are at no rung.
    pub kind: Option<RungKind>,
    /// Number of the task's latest proposals that `draws` counts, at most 256.
    pub proposals: u32,
    /// Positions on the rungs: lower quartile, median and upper quartile. Null before the first success, and under a sampler without
    /// positions.
    pub quartiles: Option<[f64; 3]>,
    /// Start of each point of the course, Unix time in seconds. Points without results are left out.
    pub at: Vec<f64>,
    /// End of each point, Unix time in seconds.
    pub until: Vec<f64>,
    /// Number of the task's episodes before each point; null if points are minutes or hours.
    pub first_episode: Vec<Option<i64>>,
    /// Number of the task's environment steps before each point; null if points are minutes or hours.
    pub first_step: Vec<Option<i64>>,
    /// Number of the task's finished and claimed episodes in each point.
    pub episodes: Vec<i64>,
    /// Number of the task's environment steps in each point; null if points are minutes or hours.
    pub steps: Vec<Option<i64>>,
    /// Highest policy version of the episodes; null if points are minutes or hours.
    pub version_high: Vec<Option<i64>>,
    /// Rungs of the task, easiest first; empty if the strategy draws params.
    pub rungs: Vec<SamplerRung>,
}

/// Rung of a task: its latest draws and results, and their course.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct SamplerRung {
    /// Number of the rung, 0 for the easiest. It is the level if levels are the rungs.
    pub rung: u32,
    /// Value of the param `start_scale` at the rung; null if levels are the rungs.
    pub start_scale: Option<f64>,
    /// Probability that the task's next proposal is at the rung; null if the strategy does not know it.
    pub probability: Option<f64>,
    /// Number of chains at the rung; null if the sampler has no chains.
    pub chains: Option<u32>,
    /// Number of successes at the rung; each episode there discounts the earlier ones by 1/64.
    pub successes: f64,
    /// Number of episodes at the rung, discounted in the same way.
    pub attempts: f64,
    /// Recent success rate at the rung, successes / attempts; null before the first result.
    pub success: Option<f64>,
    /// Number of the task's latest proposals at the rung.
    pub draws: u32,
    /// Share of the task's latest proposals at the rung, draws / proposals; null before the first proposal.
    pub share: Option<f64>,
    /// Number of groups with results in each point of the course.
    pub groups: Vec<i64>,
    /// Success rate of their finished episodes in each point; null where there is none.
    pub group_success: Vec<Option<f64>>,
}

/// Kind of the rungs of a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RungKind {
    /// Start rungs: values of the param `start_scale`.
    Start,
    /// Levels: rows of the task's level table.
    Level,
}
