//! Tasks of all worlds: parameter spaces, options, levels, actions, policies and failure modes. The types refer to the worlds' own
//! tables, so that they are here and not in `api-types`.

use env_core::critique::{FailureModeSpec, SpeedBands};
use env_core::policy::PolicySpec;
use env_core::space::{ActionSpace, Levels, OptionSpec, ParamSpec, ScoreRange};
use env_core::{Recipe, TaskSpec};
use serde::Serialize;
use utoipa::ToSchema;

use super::super::extract::NoQuery;
use super::super::problem::Problem;

/// All tasks.
#[derive(Serialize, ToSchema)]
pub(super) struct TaskList {
    /// Tasks, by world.
    tasks: Vec<Task>,
}

/// Task of a world.
#[derive(Serialize, ToSchema)]
struct Task {
    /// Id of the task: `world/task`.
    id: &'static str,
    /// World and its version.
    world: &'static str,
    /// Description in one sentence.
    about: &'static str,
    /// Parameter space.
    #[schema(value_type = Vec<Object>)]
    params: &'static [ParamSpec],
    /// Physics options.
    #[schema(value_type = Vec<Object>)]
    physics: &'static [OptionSpec],
    /// Table of levels.
    #[schema(value_type = Object)]
    levels: &'static Levels,
    /// Number of agents at the start, at default params.
    agents: u32,
    /// Number of steps after which an episode is truncated, at default params.
    horizon: u32,
    /// Action space of an agent.
    #[schema(value_type = Object)]
    actions: ActionSpace,
    /// Range of the score.
    #[schema(value_type = Object)]
    score: ScoreRange,
    /// Built-in policies: name, description, and whether their actions are random.
    #[schema(value_type = Vec<Object>)]
    policies: &'static [PolicySpec],
    /// Names of the parameters of the trainable reflex policy, each from 0 to 1.
    reflex: &'static [&'static str],
    /// Failure modes: reasons why an episode loses score.
    #[schema(value_type = Vec<Object>)]
    failure_modes: &'static [FailureModeSpec],
    /// Bands of relative speed: upper edges of all bands but the last.
    #[schema(value_type = Object)]
    speed_bands: SpeedBands,
}

impl Task {
    fn new(task: &'static dyn TaskSpec) -> Result<Self, Problem> {
        let recipe = Recipe::with_params(task, std::iter::empty())?;
        Ok(Self {
            id: task.id(),
            world: task.world(),
            about: task.about(),
            params: task.params(),
            physics: task.options(),
            levels: task.levels(),
            agents: task.agents(&recipe),
            horizon: task.horizon(&recipe),
            actions: task.action_space(),
            score: task.score_range(),
            policies: task.policies(),
            reflex: task.reflex().names,
            failure_modes: task.failure_modes(),
            speed_bands: task.speed_bands(),
        })
    }
}

/// List the tasks with their parameter spaces, levels, actions, policies and failure modes.
#[utoipa::path(
    get, path = "/tasks", tag = "scenarios",
    responses((status = 200, body = TaskList), (status = 400, body = Problem, description = "The request has a query."))
)]
pub(super) async fn list_tasks(_: NoQuery) -> Result<axum::Json<TaskList>, Problem> {
    let tasks = env_core::tasks().map(Task::new).collect::<Result<_, _>>()?;
    Ok(axum::Json(TaskList { tasks }))
}
