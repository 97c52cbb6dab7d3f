//! Descriptions of tasks, and the built-in policies.

use std::sync::{Mutex, PoisonError};

use env_core::kessler::tracks::{DEFAULT_LOOK_AHEAD, DEFAULT_THREATS};
use env_core::log::Precision;
use env_core::policy::Policy;
use env_core::space::Axes;
use env_core::{ActionLog, Recipe, TaskSpec};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::errors::{invalid, rejected, scenario_error};
use crate::scenario::NativeScenario;

/// Returns the ids of all tasks.
#[pyfunction]
pub(crate) fn tasks() -> Vec<&'static str> {
    env_core::tasks().map(TaskSpec::id).collect()
}

/// Describes a task as JSON: params, options, levels, actions, policies.
#[pyfunction]
pub(crate) fn task_info(task: &str) -> PyResult<String> {
    let task = find_task(task)?;
    let recipe = Recipe::new(task).map_err(|error| scenario_error(&error))?;
    let levels = task.levels();
    let levels: Vec<Value> = (0..levels.len())
        .map(|level| levels.params(level).map(|(name, value)| (name.to_owned(), value.into())).collect())
        .map(Value::Object)
        .collect();
    let (choices, few) = (task.action_grid(), task.few_actions());
    let info = json!({
        "id": task.id(),
        "world": task.world(),
        "description": task.description(),
        "horizon": task.horizon(&recipe),
        "time_limit_s": task.time_limit_s(&recipe),
        "agents": task.agents(&recipe),
        "params": task.params(),
        "options": task.options(),
        "levels": levels,
        "start_rungs": task.start_rungs(),
        "score_range": task.score_range(),
        "actions": task.action_space(),
        "agent_axes": task.agent_axes(),
        "choices": {
            "axes": if choices.axes == Axes::Agent { "agent" } else { "world" },
            "rows": choices.rows,
            "hold": choices.hold,
            "description": choices.description,
        },
        "few_choices": { "rows": few.rows, "description": few.description },
        "policies": task.policies(),
        "threats": DEFAULT_THREATS,
        "look_ahead": DEFAULT_LOOK_AHEAD,
    });
    Ok(info.to_string())
}

/// Finds a task by its id, or by its name alone if that is unambiguous.
fn find_task(id: &str) -> PyResult<&'static dyn TaskSpec> {
    let has_name = |task: &&'static dyn TaskSpec| task.id().split('/').next_back() == Some(id);
    env_core::task(id).or_else(|| env_core::tasks().find(has_name)).ok_or_else(|| {
        let known: Vec<&str> = env_core::tasks().map(TaskSpec::id).collect();
        invalid("task", format!("one of {}", known.join(", ")), format!("{id:?}"))
    })
}

/// A built-in policy for one scenario.
#[pyclass(frozen, module = "sparring._native")]
pub(crate) struct NativePolicy {
    task: &'static dyn TaskSpec,
    agents: usize,
    policy: Mutex<Box<dyn Policy>>,
}

#[pymethods]
impl NativePolicy {
    #[new]
    fn new(name: &str, scenario: &NativeScenario, seed: u64) -> PyResult<Self> {
        let task = scenario.0.task();
        let policy = task.policy(name, &scenario.0, seed).map_err(|error| rejected("policy", error))?;
        let agents = task.agents(scenario.0.recipe()) as usize;
        Ok(Self { task, agents, policy: Mutex::new(policy) })
    }

    /// Returns the action of each agent, along the world's axes, for an observation in the wire form (JSON).
    #[pyo3(signature = (telemetry) -> "numpy.typing.NDArray[numpy.float64]")]
    fn act<'py>(&self, py: Python<'py>, telemetry: &str) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let wire: Value = serde_json::from_str(telemetry).map_err(|error| rejected("telemetry", error))?;
        let observation = self.task.read_observation(&wire).map_err(|error| rejected("telemetry", error))?;
        let space = self.task.action_space();
        let mut log = ActionLog::new(space.dim(), Precision::F64);
        let acted = self.policy.lock().unwrap_or_else(PoisonError::into_inner).act(&*observation, &mut log);
        acted.map_err(|error| rejected("policy", error))?;
        let values = log.step(log.len().saturating_sub(1)).by_agent(&space, self.agents);
        PyArray1::from_vec(py, values).reshape([self.agents, space.dim()])
    }
}
