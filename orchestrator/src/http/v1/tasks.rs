//! Tasks of all worlds, converted from the worlds' own tables.

use api_types::{
    BuiltInPolicy, HarderDirection, LevelTable, ManualPhysicsChoice, PhysicsOption, PhysicsOptionType,
    SectorQuantity, Task, TaskActionKind, TaskActionSpace, TaskFailureMode, TaskList, TaskParam,
    TaskScoreRange, TaskSpeedBands,
};
use env_core::critique::{self, FailureModeSpec, SpeedBands};
use env_core::policy::PolicySpec;
use env_core::space::{ActionKind, ActionSpace, Harder, Levels, OptionSpec, ParamSpec, ScoreRange};
use env_core::{Recipe, TaskSpec};

use crate::http::extract::NoQuery;
use crate::http::problem::Problem;

/// List the tasks with their parameter spaces, levels, actions, policies and failure modes.
#[utoipa::path(
    get, path = "/tasks", tag = "tasks",
    responses((status = 200, body = TaskList), (status = 400, body = Problem, description = "The request has a query."))
)]
pub(super) async fn list_tasks(_: NoQuery) -> Result<axum::Json<TaskList>, Problem> {
    let tasks = env_core::tasks().map(task_response).collect::<Result<_, _>>()?;
    Ok(axum::Json(TaskList { tasks }))
}

/// Converts a task; agents and horizon are those of its default params.
fn task_response(task: &'static dyn TaskSpec) -> Result<Task, Problem> {
    let recipe = Recipe::with_params(task, std::iter::empty())?;
    Ok(Task {
        id: task.id().to_owned(),
        world: task.world().to_owned(),
        description: task.description().to_owned(),
        params: task.params().iter().map(task_param).collect(),
        physics: task.options().iter().map(physics_option).collect(),
        levels: level_table(task.levels()),
        start_rungs: task.start_rungs().to_vec(),
        agents: task.agents(&recipe),
        horizon: task.horizon(&recipe),
        time_limit_s: task.time_limit_s(&recipe),
        actions: action_space(&task.action_space()),
        score: score_range(task.score_range()),
        policies: task.policies().iter().map(built_in_policy).collect(),
        reflex_params: to_strings(task.reflex().names),
        failure_modes: task.failure_modes().iter().map(failure_mode).collect(),
        speed_bands: speed_bands(task.speed_bands()),
        sector_quantity: sector_quantity(task.sector_quantity()),
    })
}

fn to_strings(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn task_param(spec: &ParamSpec) -> TaskParam {
    TaskParam {
        name: spec.name.to_owned(),
        unit: spec.unit.to_owned(),
        min: spec.min,
        max: spec.max,
        step: spec.step,
        whole: spec.whole,
        default: spec.default,
        harder: match spec.harder {
            Harder::Up => HarderDirection::Up,
            Harder::Down => HarderDirection::Down,
        },
        description: spec.description.to_owned(),
    }
}

fn physics_option(spec: &OptionSpec) -> PhysicsOption {
    let manual_choices = spec.manual_choices.iter().map(|manual| ManualPhysicsChoice {
        choice: manual.choice.to_owned(),
        reason: manual.reason.to_owned(),
    });
    PhysicsOption {
        name: spec.name.to_owned(),
        kind: PhysicsOptionType::Choice,
        choices: to_strings(spec.choices),
        default: spec.default_choice().to_owned(),
        description: spec.description.to_owned(),
        manual_choices: manual_choices.collect(),
    }
}

fn level_table(levels: &Levels) -> LevelTable {
    let row = |level| levels.params(level).map(|(_, value)| value).collect();
    LevelTable { columns: levels.columns().to_vec(), rows: (0..levels.len()).map(row).collect() }
}

fn action_space(space: &ActionSpace) -> TaskActionSpace {
    TaskActionSpace {
        kind: match space.kind {
            ActionKind::Box => TaskActionKind::Box,
            ActionKind::Discrete { .. } => TaskActionKind::Discrete,
        },
        names: to_strings(space.names()),
        columns: to_strings(space.columns),
        low: space.low,
        high: space.high,
        unit: space.unit.to_owned(),
        hold: f64::from(space.hold),
    }
}

const fn score_range(ScoreRange { min, max }: ScoreRange) -> TaskScoreRange {
    TaskScoreRange { min, max }
}

fn built_in_policy(spec: &PolicySpec) -> BuiltInPolicy {
    BuiltInPolicy {
        name: spec.name.to_owned(),
        description: spec.description.to_owned(),
        stochastic: spec.stochastic,
    }
}

fn failure_mode(spec: &FailureModeSpec) -> TaskFailureMode {
    TaskFailureMode { name: spec.name.to_owned(), description: spec.description.to_owned() }
}

/// Converts the angle by whose sectors failure profiles are divided.
pub(super) fn sector_quantity(quantity: critique::SectorQuantity) -> SectorQuantity {
    SectorQuantity {
        name: quantity.name.to_owned(),
        description: quantity.description.to_owned(),
        directions: quantity.directions.map(str::to_owned).to_vec(),
    }
}

fn speed_bands(SpeedBands { edges, unit }: SpeedBands) -> TaskSpeedBands {
    TaskSpeedBands { edges: edges.to_vec(), unit: unit.to_owned() }
}

#[cfg(test)]
mod tests {
    use serde_json::to_value;

    use super::*;

    /// The command line prints the tables of `env_core` as they are; the API must not differ.
    #[test]
    fn tasks_have_the_json_of_the_worlds_tables() {
        for spec in env_core::tasks() {
            let task = to_value(task_response(spec).expect("default params are valid")).unwrap();
            let json = |value: Result<serde_json::Value, _>| value.unwrap();
            assert_eq!(task["params"], json(to_value(spec.params())));
            assert_eq!(task["physics"], json(to_value(spec.options())));
            assert_eq!(task["levels"], json(to_value(spec.levels())));
            assert_eq!(task["actions"], json(to_value(spec.action_space())));
            assert_eq!(task["score"], json(to_value(spec.score_range())));
            assert_eq!(task["policies"], json(to_value(spec.policies())));
            assert_eq!(task["failure_modes"], json(to_value(spec.failure_modes())));
            assert_eq!(task["speed_bands"], json(to_value(spec.speed_bands())));
            assert_eq!(task["sector_quantity"], json(to_value(spec.sector_quantity())));
        }
    }
}
