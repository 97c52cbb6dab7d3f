//! Scenarios, what they are worth, and what was flown on them.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::sync::Arc;

use env_core::bracket::{admit, panel_success, success};
use env_core::log::Precision;
use env_core::rollout;
use env_core::{ActionLog, Bracket, Flown, Recipe, Scenario, Stopped, SuccessRule};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::arrays::read_f64;
use crate::errors::{self, invalid};

/// A scenario: `(scenario, actions)` decides every bit of an episode.
#[pyclass(frozen, eq, from_py_object, module = "sparring._native")]
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NativeScenario(pub(crate) Scenario);

fn read(text: &str) -> PyResult<Value> {
    serde_json::from_str(text).map_err(|error| invalid("scenario", error))
}

/// A recipe out of JSON.
pub(crate) fn recipe(text: &str) -> PyResult<Arc<Recipe>> {
    Recipe::from_json(&read(text)?).map(Arc::new).map_err(|error| errors::scenario(&error))
}

#[pymethods]
impl NativeScenario {
    /// Reads the wire form. With `any_seed` training and evaluation seeds are read too: to look at, not to fly in an environment.
    #[new]
    #[pyo3(signature = (text, any_seed=false))]
    fn new(text: &str, any_seed: bool) -> PyResult<Self> {
        let scenario = Scenario::from_json(&read(text)?).map_err(|error| errors::scenario(&error))?;
        if !any_seed {
            env_core::Seed::user(scenario.seed().get()).map_err(|error| errors::scenario(&error))?;
        }
        Ok(Self(scenario))
    }

    /// The wire form, complete.
    fn to_json(&self) -> String {
        self.0.to_json().to_string()
    }

    /// Its id: the blake3 of its canonical form.
    #[getter]
    fn id(&self) -> String {
        self.0.id().to_string()
    }

    /// The task's id.
    #[getter]
    fn task(&self) -> &'static str {
        self.0.task().id()
    }

    /// Its seed.
    #[getter]
    fn seed(&self) -> u64 {
        self.0.seed().get()
    }

    /// Steps after which an episode is truncated.
    #[getter]
    fn horizon(&self) -> u32 {
        self.0.task().horizon(self.0.recipe())
    }

    /// Agents at the start.
    #[getter]
    fn agents(&self) -> u32 {
        self.0.task().agents(self.0.recipe())
    }

    fn __hash__(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.0.id().hash(&mut hasher);
        hasher.finish()
    }
}

fn told(scenario: &Scenario, bracket: &Bracket, flown: &Flown) -> Value {
    json!({
        "score": flown.score,
        "total_reward": flown.total,
        "steps": flown.steps,
        "lost": flown.lost,
        "goal": flown.goal,
        "fuel_used": flown.fuel_used,
        "skill": bracket.skill(flown.score),
        "success": success(scenario, SuccessRule::Task, bracket, flown),
    })
}

fn unplanned(flown: &Flown) -> Value {
    json!({
        "score": flown.score,
        "total_reward": flown.total,
        "steps": flown.steps,
        "lost": flown.lost,
        "goal": flown.goal,
        "fuel_used": flown.fuel_used,
    })
}

/// A log as an array: steps × agents × values, zeros where nothing was done.
fn dense<'py>(py: Python<'py>, scenario: &Scenario, log: &ActionLog) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let agents = scenario.task().agents(scenario.recipe()) as usize;
    let dim = log.dim();
    let mut values = vec![0.0; log.len() * agents * dim];
    for (step, action) in log.steps().enumerate() {
        for (&agent, acted) in action.agents.iter().zip(action.values.chunks_exact(dim.max(1))) {
            let at = (step * agents + agent as usize) * dim;
            if let Some(cells) = values.get_mut(at..at + dim) {
                cells.iter_mut().zip(acted).for_each(|(cell, value)| *cell += value);
            }
        }
    }
    PyArray1::from_vec(py, values).reshape([log.len(), agents, dim])
}

/// An array (steps × agents × values) as a log; in single precision where the array is.
fn log(scenario: &Scenario, actions: &Bound<'_, PyAny>, stopped: Option<&str>) -> PyResult<ActionLog> {
    let task = scenario.task();
    let (agents, dim) = (task.agents(scenario.recipe()) as usize, task.action_space().columns.len());
    let (values, steps, single) = read_f64("actions", actions, &[agents, dim])?;
    if !values.iter().all(|value| value.is_finite()) {
        return Err(invalid("actions", "not all are finite numbers"));
    }
    let mut log = ActionLog::new(dim, if single { Precision::F32 } else { Precision::F64 });
    for step in values.chunks_exact((agents * dim).max(1)).take(steps) {
        for (agent, acted) in (0u32..).zip(step.chunks_exact(dim)) {
            log.act(agent, acted);
        }
        log.end_step();
    }
    log.stopped = stopped
        .map(|word| {
            Stopped::from_word(word).ok_or_else(|| {
                invalid("stopped", format!("{word:?} is none of unparsable, too_long, too_late"))
            })
        })
        .transpose()?;
    Ok(log)
}

/// What a scenario is worth, as JSON, and the reference's actions.
#[pyfunction]
#[pyo3(signature = (scenario) -> "tuple[str, numpy.typing.NDArray[numpy.float64]]")]
pub(crate) fn bracket<'py>(
    py: Python<'py>,
    scenario: &NativeScenario,
) -> PyResult<(String, Bound<'py, PyArray3<f64>>)> {
    let of = &scenario.0;
    let admission = py.detach(|| admit(of));
    admission.fair.as_ref().map_err(errors::scenario)?;
    let Some(bracket) = &admission.bracket else {
        return Err(invalid("scenario", "it has no bracket"));
    };
    let panel: Vec<Value> = bracket.panel.iter().map(|flown| told(of, bracket, flown)).collect();
    let json = json!({
        "planner": bracket.planner,
        "panel": panel,
        "panel_success": panel_success(of, bracket),
        "floor": bracket.floor,
        "reference": told(of, bracket, &bracket.reference),
        "solvable": admission.solvable,
        "contested": admission.contested,
    });
    Ok((json.to_string(), dense(py, of, &bracket.witness)?))
}

/// What an episode shows, as JSON.
#[pyfunction]
#[pyo3(signature = (scenario, actions, stopped=None))]
pub(crate) fn critique(
    py: Python<'_>,
    scenario: &NativeScenario,
    actions: &Bound<'_, PyAny>,
    stopped: Option<&str>,
) -> PyResult<String> {
    let log = log(&scenario.0, actions, stopped)?;
    let found = py.detach(|| scenario.0.task().critique(&scenario.0, &log));
    let found = found.map_err(|error| invalid("actions", error))?;
    serde_json::to_string(&found).map_err(|error| invalid("actions", error))
}

/// What these actions earn on a scenario, as JSON.
#[pyfunction]
#[pyo3(signature = (scenario, actions, stopped=None))]
pub(crate) fn replay(
    py: Python<'_>,
    scenario: &NativeScenario,
    actions: &Bound<'_, PyAny>,
    stopped: Option<&str>,
) -> PyResult<String> {
    let log = log(&scenario.0, actions, stopped)?;
    let flown = py.detach(|| rollout::replay(&scenario.0, &log));
    Ok(unplanned(&flown.map_err(|error| invalid("actions", error))?).to_string())
}

/// Flies a scenario by a built-in policy to its end: how it went, as JSON, and what was done.
#[pyfunction]
#[pyo3(signature = (scenario, policy, seed) -> "tuple[str, numpy.typing.NDArray[numpy.float64]]")]
pub(crate) fn fly<'py>(
    py: Python<'py>,
    scenario: &NativeScenario,
    policy: &str,
    seed: u64,
) -> PyResult<(String, Bound<'py, PyArray3<f64>>)> {
    let of = &scenario.0;
    let mut pilot = of.task().policy(policy, of, seed).map_err(|error| invalid("policy", error))?;
    let flown = py.detach(|| rollout::fly(of, &mut *pilot));
    let (flown, log) = flown.map_err(|error| invalid("scenario", error))?;
    Ok((unplanned(&flown).to_string(), dense(py, of, &log)?))
}
