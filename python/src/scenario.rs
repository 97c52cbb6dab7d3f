//! Scenarios, their brackets, and replays and critiques of episodes.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::sync::Arc;

use env_core::admission::{admit, count_panel_successes, is_success};
use env_core::log::Precision;
use env_core::rollout as rollouts;
use env_core::{ActionLog, Bracket, EpisodeOutcome, Recipe, Scenario, StopReason, SuccessRule};
use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use serde_json::{Value, json};

use crate::arrays::{NumericRows, read_f64};
use crate::errors::{invalid, rejected, scenario_error};

/// A scenario: `(scenario, actions)` decides every bit of an episode.
#[pyclass(frozen, eq, from_py_object, module = "sparring._native")]
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NativeScenario(pub(crate) Scenario);

#[pymethods]
impl NativeScenario {
    /// Reads the wire form (JSON).
    ///
    /// With `any_seed`, seeds of training and evaluation are accepted too. No environment starts such a scenario.
    #[new]
    #[pyo3(signature = (text, any_seed=false))]
    fn new(text: &str, any_seed: bool) -> PyResult<Self> {
        let scenario = Scenario::from_json(&parse_json(text)?).map_err(|error| scenario_error(&error))?;
        if !any_seed {
            env_core::Seed::user(scenario.seed().get()).map_err(|error| scenario_error(&error))?;
        }
        Ok(Self(scenario))
    }

    /// Returns the complete wire form (JSON).
    fn to_json(&self) -> String {
        self.0.to_json().to_string()
    }

    /// Id: the blake3 hash of the canonical form.
    #[getter]
    fn id(&self) -> String {
        self.0.id().to_string()
    }

    /// Id of the task.
    #[getter]
    fn task(&self) -> &'static str {
        self.0.task().id()
    }

    /// Seed of all random draws.
    #[getter]
    fn seed(&self) -> u64 {
        self.0.seed().get()
    }

    /// Number of steps after which an episode is truncated.
    #[getter]
    fn horizon(&self) -> u32 {
        self.0.task().horizon(self.0.recipe())
    }

    /// Number of agents at the start.
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

/// Brackets a scenario: floor and reference as JSON, and the actions of the reference plan.
#[pyfunction]
#[pyo3(signature = (scenario) -> "tuple[str, numpy.typing.NDArray[numpy.float64]]")]
pub(crate) fn bracket<'py>(
    py: Python<'py>,
    scenario: &NativeScenario,
) -> PyResult<(String, Bound<'py, PyArray3<f64>>)> {
    let scenario = &scenario.0;
    let admission = py.detach(|| admit(scenario));
    admission.fair.as_ref().map_err(scenario_error)?;
    let Some(bracket) = &admission.bracket else {
        return Err(rejected("scenario", "it has no bracket; choose another seed or other params"));
    };
    let panel: Vec<Value> =
        bracket.panel.iter().map(|outcome| bracketed_json(scenario, bracket, outcome)).collect();
    let json = json!({
        "planner_version": bracket.planner_version,
        "panel": panel,
        "panel_successes": count_panel_successes(scenario, bracket),
        "floor": bracket.floor,
        "reference": bracketed_json(scenario, bracket, &bracket.reference),
        "solvable": admission.solvable,
        "contested": admission.contested,
    });
    Ok((json.to_string(), log_to_array(py, scenario, &bracket.reference_plan)?))
}

/// Criticises an episode; returns its failures and a verdict on each action as JSON.
#[pyfunction]
#[pyo3(signature = (scenario, actions, stopped=None))]
pub(crate) fn critique(
    py: Python<'_>,
    scenario: &NativeScenario,
    actions: &Bound<'_, PyAny>,
    stopped: Option<&str>,
) -> PyResult<String> {
    let log = read_log(&scenario.0, actions, stopped)?;
    let critique = py.detach(|| scenario.0.task().critique(&scenario.0, &log));
    let critique = critique.map_err(|error| rejected("actions", error))?;
    serde_json::to_string(&critique).map_err(|error| rejected("actions", error))
}

/// Replays actions on a scenario; returns the outcome as JSON.
#[pyfunction]
#[pyo3(signature = (scenario, actions, stopped=None))]
pub(crate) fn replay(
    py: Python<'_>,
    scenario: &NativeScenario,
    actions: &Bound<'_, PyAny>,
    stopped: Option<&str>,
) -> PyResult<String> {
    let log = read_log(&scenario.0, actions, stopped)?;
    let outcome = py.detach(|| rollouts::replay(&scenario.0, &log));
    Ok(outcome_json(&outcome.map_err(|error| rejected("actions", error))?).to_string())
}

/// Runs a built-in policy on a scenario to the end; returns the outcome as JSON, and the actions.
#[pyfunction]
#[pyo3(signature = (scenario, policy, seed) -> "tuple[str, numpy.typing.NDArray[numpy.float64]]")]
pub(crate) fn rollout<'py>(
    py: Python<'py>,
    scenario: &NativeScenario,
    policy: &str,
    seed: u64,
) -> PyResult<(String, Bound<'py, PyArray3<f64>>)> {
    let scenario = &scenario.0;
    let mut policy =
        scenario.task().policy(policy, scenario, seed).map_err(|error| rejected("policy", error))?;
    let rollout = py.detach(|| rollouts::roll_out(scenario, &mut *policy));
    let rollout = rollout.map_err(|error| rejected("scenario", error))?;
    Ok((outcome_json(&rollout.outcome).to_string(), log_to_array(py, scenario, &rollout.log)?))
}

/// Parses a recipe from JSON.
///
/// # Errors
/// `ValueError` if the text is no JSON or no valid recipe.
pub(crate) fn parse_recipe(text: &str) -> PyResult<Arc<Recipe>> {
    Recipe::from_json(&parse_json(text)?).map(Arc::new).map_err(|error| scenario_error(&error))
}

fn parse_json(text: &str) -> PyResult<Value> {
    serde_json::from_str(text).map_err(|error| rejected("scenario", error))
}

fn outcome_json(outcome: &EpisodeOutcome) -> Value {
    json!({
        "score": outcome.score,
        "total_reward": outcome.total_reward,
        "steps": outcome.steps,
        "lost": outcome.lost,
        "goal": outcome.goal,
        "fuel_used": outcome.fuel_used,
        "time_s": outcome.time_s,
    })
}

/// Outcome of a plan of the bracket, with its skill and success.
fn bracketed_json(scenario: &Scenario, bracket: &Bracket, outcome: &EpisodeOutcome) -> Value {
    let mut json = outcome_json(outcome);
    json["skill"] = json!(bracket.skill(outcome.score));
    json["success"] = json!(is_success(scenario, SuccessRule::Task, bracket, outcome));
    json
}

/// Converts an action log to an array of steps × agents × values; an agent without an action holds.
fn log_to_array<'py>(
    py: Python<'py>,
    scenario: &Scenario,
    log: &ActionLog,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let agents = scenario.task().agents(scenario.recipe()) as usize;
    let space = scenario.task().action_space();
    let values = log.steps().flat_map(|step| step.by_agent(&space, agents)).collect();
    PyArray1::from_vec(py, values).reshape([log.len(), agents, space.dim()])
}

/// Converts an array of steps × agents × values to an action log of the same precision.
fn read_log(scenario: &Scenario, actions: &Bound<'_, PyAny>, stopped: Option<&str>) -> PyResult<ActionLog> {
    let task = scenario.task();
    let (agents, space) = (task.agents(scenario.recipe()) as usize, task.action_space());
    let dim = space.dim();
    let NumericRows { values, len: steps, is_single_precision } =
        read_f64("actions", actions, &[agents, dim])?;
    if !values.iter().all(|value| value.is_finite()) {
        return Err(invalid("actions", "finite numbers", "NaN or an infinity"));
    }
    let precision = if is_single_precision { Precision::F32 } else { Precision::F64 };
    let mut log = ActionLog::new(dim, precision);
    for step in values.chunks_exact((agents * dim).max(1)).take(steps) {
        log.push_by_agent(&space, step);
    }
    log.stopped = stopped
        .map(|name| {
            StopReason::from_name(name).ok_or_else(|| {
                invalid("stopped", "one of unparsable, too_long, too_late", format!("{name:?}"))
            })
        })
        .transpose()?;
    Ok(log)
}
