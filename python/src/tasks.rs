//! Tasks as data, and the policies without a model.

use std::sync::{Mutex, PoisonError};

use env_core::batch::Axes;
use env_core::kessler::tracks::{LOOK_AHEAD, THREATS};
use env_core::log::Precision;
use env_core::policy::Policy;
use env_core::{ActionLog, Recipe, TaskSpec};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::errors::{self, invalid};
use crate::scenario::NativeScenario;

/// A task by its id, with or without its world where that leaves no doubt.
pub(crate) fn find(id: &str) -> PyResult<&'static dyn TaskSpec> {
    let short = |task: &&'static dyn TaskSpec| task.id().split('/').next_back() == Some(id);
    env_core::task(id).or_else(|| env_core::tasks().find(short)).ok_or_else(|| {
        let known: Vec<&str> = env_core::tasks().map(TaskSpec::id).collect();
        invalid("task", format!("{id:?} is none of {}", known.join(", ")))
    })
}

/// The ids of all tasks.
#[pyfunction]
pub(crate) fn tasks() -> Vec<&'static str> {
    env_core::tasks().map(TaskSpec::id).collect()
}

/// A task as data, as JSON: params, options, levels, actions, policies.
#[pyfunction]
pub(crate) fn card(task: &str) -> PyResult<String> {
    let task = find(task)?;
    let recipe = Recipe::new(task).map_err(|error| errors::scenario(&error))?;
    let levels = task.levels();
    let levels: Vec<Value> = (0..levels.len())
        .map(|level| levels.params(level).map(|(name, value)| (name.to_owned(), value.into())).collect())
        .map(Value::Object)
        .collect();
    let choices = task.choices();
    let card = json!({
        "id": task.id(),
        "world": task.world(),
        "about": task.about(),
        "horizon": task.horizon(&recipe),
        "agents": task.agents(&recipe),
        "params": task.params(),
        "options": task.options(),
        "levels": levels,
        "score_range": task.score_range(),
        "actions": task.action_space(),
        "agent_axes": task.agent_axes(),
        "choices": {
            "axes": if choices.axes == Axes::Agent { "agent" } else { "world" },
            "rows": choices.rows,
            "about": choices.about,
        },
        "policies": task.policies(),
        "threats": THREATS,
        "look_ahead": LOOK_AHEAD,
    });
    Ok(card.to_string())
}

/// A built-in policy that flies a scenario.
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
        let policy = task.policy(name, &scenario.0, seed).map_err(|error| invalid("policy", error))?;
        let agents = task.agents(scenario.0.recipe()) as usize;
        Ok(Self { task, agents, policy: Mutex::new(policy) })
    }

    /// What each agent does, along the world's axes, on what it sees (the wire form, as JSON).
    #[pyo3(signature = (telemetry) -> "numpy.typing.NDArray[numpy.float64]")]
    fn act<'py>(&self, py: Python<'py>, telemetry: &str) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let wire: Value = serde_json::from_str(telemetry).map_err(|error| invalid("telemetry", error))?;
        let seen = self.task.read_observation(&wire).map_err(|error| invalid("telemetry", error))?;
        let dim = self.task.action_space().columns.len();
        let mut log = ActionLog::new(dim, Precision::F64);
        self.policy.lock().unwrap_or_else(PoisonError::into_inner).act(&*seen, &mut log);
        let mut values = vec![0.0; self.agents * dim];
        let step = log.step(log.len().saturating_sub(1));
        for (&agent, acted) in step.agents.iter().zip(step.values.chunks_exact(dim)) {
            if let Some(cells) = values.get_mut(agent as usize * dim..(agent as usize + 1) * dim) {
                cells.iter_mut().zip(acted).for_each(|(cell, value)| *cell += value);
            }
        }
        PyArray1::from_vec(py, values).reshape([self.agents, dim])
    }
}
