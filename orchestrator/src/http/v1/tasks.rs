//! Tasks: parameter spaces, options, levels, actions.

use env_core::space::{ActionSpace, Levels, OptionSpec, ParamSpec, ScoreRange};
use serde::Serialize;
use utoipa::ToSchema;

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
    /// What an agent does in a step.
    #[schema(value_type = Object)]
    actions: ActionSpace,
    /// The range of the score.
    #[schema(value_type = Object)]
    score: ScoreRange,
}

/// List the tasks with their parameter spaces and levels.
#[utoipa::path(get, path = "/tasks", tag = "scenarios", responses((status = 200, body = Tasks)))]
pub(super) async fn list() -> axum::Json<Tasks> {
    let tasks = env_core::tasks()
        .map(|task| Task {
            id: task.id(),
            world: task.world(),
            about: task.about(),
            params: task.params(),
            physics: task.options(),
            levels: task.levels(),
            actions: task.action_space(),
            score: task.score_range(),
        })
        .collect();
    axum::Json(Tasks { tasks })
}
