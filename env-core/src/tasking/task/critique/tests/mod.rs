//! Tests of critiques: episodes whose faults are known, and laws of all critiques.

mod images;
mod laws;
mod resources;

use crate::critique::{Critique, Failure};
use crate::log::{ActionLog, Precision};
use crate::seed::Seed;
use crate::task::{Recipe, Scenario, TaskSpec};
use crate::tasking::task::TASKING_TASKS;
use crate::tasking::task::run::TaskRun;
use crate::tasking::task::task_setup::TaskSetup;

/// Index of a task among those of the world.
const SCANNING: usize = 0;
const IMAGING: usize = 1;
const CONSTELLATION: usize = 2;

/// Params of a scanner that lacks nothing, over two orbits.
const RICH_SCANNER: [(&str, f64); 9] = [
    ("battery_wh", 2000.0),
    ("charge_min", 0.8),
    ("charge_max", 0.8),
    ("panel_m2", 2.0),
    ("storage_gbit", 1000.0),
    ("storage_fill", 0.0),
    ("wheel_rpm", 0.0),
    ("disturbance_mnm", 0.0),
    ("time_limit_s", 12_000.0),
];

/// Params of agile imagers that lack nothing, over half an orbit.
const RICH_IMAGER: [(&str, f64); 7] = [
    ("battery_wh", 2000.0),
    ("charge_min", 0.8),
    ("charge_max", 0.8),
    ("panel_m2", 2.0),
    ("targets", 600.0),
    ("priority_power", 1.0),
    ("time_limit_s", 3000.0),
];

fn task(index: usize) -> &'static dyn TaskSpec {
    &TASKING_TASKS[index]
}

/// A scenario of a task: some params, and others that replace them.
fn scenario(
    index: usize,
    params: &[(&'static str, f64)],
    others: &[(&'static str, f64)],
    seed: u64,
) -> Scenario {
    let kept = params.iter().filter(|(name, _)| !others.iter().any(|(other, _)| other == name));
    let all = kept.chain(others).copied();
    Scenario::new(Recipe::with_params(task(index), all).unwrap(), Seed::user(seed).unwrap())
}

fn start(scenario: &Scenario) -> TaskRun {
    TaskRun::start(TaskSetup::read(scenario.recipe()).unwrap(), scenario.seed()).unwrap()
}

/// The log of an episode in which `choose` gives the index of the action of each satellite that needs one.
fn fly(scenario: &Scenario, mut choose: impl FnMut(&mut TaskRun, usize) -> Option<usize>) -> ActionLog {
    let mut run = start(scenario);
    let mut log = ActionLog::new(1, Precision::F64);
    while !run.is_done() {
        let agents = run.sim.len();
        let indices: Vec<_> = (0..agents)
            .map(|agent| if run.needs_action(agent) { choose(&mut run, agent) } else { None })
            .collect();
        for (agent, index) in (0..).zip(&indices) {
            if let Some(index) = index {
                log.push_entry(agent, &[*index as f64]);
            }
        }
        log.end_step();
        let actions = run.choose(|agent| indices[agent]);
        run.step(&actions);
    }
    log
}

fn critique_of(scenario: &Scenario, log: &ActionLog) -> Critique {
    scenario.task().critique(scenario, log).unwrap()
}

/// The critique of an episode in which `choose` gives the actions.
fn critique_by(scenario: &Scenario, choose: impl FnMut(&mut TaskRun, usize) -> Option<usize>) -> Critique {
    critique_of(scenario, &fly(scenario, choose))
}

/// Failures of a mode.
fn of_mode<'a>(critique: &'a Critique, mode: &str) -> Vec<&'a Failure> {
    critique.failures.iter().filter(|failure| failure.mode == mode).collect()
}

/// Value of a measure of a failure.
fn measured(failure: &Failure, name: &str) -> f64 {
    let measure = failure.measures.iter().find(|measure| measure.name == name);
    measure.unwrap_or_else(|| panic!("{name} of {failure:?}")).value
}
