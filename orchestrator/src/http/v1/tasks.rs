//! Tasks: parameter spaces, options, levels, actions, policies, failure modes.

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
pub(super) struct Tasks {
    /// World by world.
    tasks: Vec<Task>,
}

/// One task, as data.
#[derive(Serialize, ToSchema)]
struct Task {
    /// `world/task`.
    id: &'static str,
    /// The world and its version.
    world: &'static str,
    /// One sentence.
    about: &'static str,
    /// The parameter space.
    #[schema(value_type = Vec<Object>)]
    params: &'static [ParamSpec],
    /// The physics options.
    #[schema(value_type = Vec<Object>)]
    physics: &'static [OptionSpec],
    /// The table of levels.
    #[schema(value_type = Object)]
    levels: &'static Levels,
    /// Agents at the start, at default params.
    agents: u32,
    /// Steps after which an episode is cut off, at default params.
    horizon: u32,
    /// What an agent does in a step.
    #[schema(value_type = Object)]
    actions: ActionSpace,
    /// The range of the score.
    #[schema(value_type = Object)]
    score: ScoreRange,
    /// The built-in policies: name, what each does, and whether its actions are drawn.
    #[schema(value_type = Vec<Object>)]
    policies: &'static [PolicySpec],
    /// Names of the numbers of the trainable reflex, each within 0 to 1.
    reflex: &'static [&'static str],
    /// Why an episode can lose score.
    #[schema(value_type = Vec<Object>)]
    failure_modes: &'static [FailureModeSpec],
    /// How relative speeds are sorted: the upper edges of all bands but the last.
    #[schema(value_type = Object)]
    speed_bands: SpeedBands,
}

impl Task {
    fn of(task: &'static dyn TaskSpec) -> Result<Self, Problem> {
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
    responses((status = 200, body = Tasks), (status = 400, body = Problem, description = "A query."))
)]
pub(super) async fn list(_: NoQuery) -> Result<axum::Json<Tasks>, Problem> {
    let tasks = env_core::tasks().map(Task::of).collect::<Result<_, _>>()?;
    Ok(axum::Json(Tasks { tasks }))
}
