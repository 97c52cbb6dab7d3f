//! Forks: episodes that branch off the logged one at a step and go on differently. They run side by side in lanes.

use super::trace::TaskingTrace;
use crate::bracket::EpisodeOutcome;
use crate::error::ReplayError;
use crate::log::ActionLog;
use crate::task::Scenario;
use crate::tasking::error::TaskingError;
use crate::tasking::simulation::{AgentAction, StepResult, TaskingSim, step_all};
use crate::tasking::task::run::TaskRun;
use crate::tasking::task::task_setup::TaskSetup;
use crate::tasking::tick::dispatch::InstructionSet;

/// Number of forks that run together, which bounds the memory of a critique.
const TOGETHER: usize = 64;

/// A fork, and the step before which it branches off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ForkRequest {
    /// Step that the fork changes first, from 1.
    pub step: u32,
    /// Change of the episode.
    pub change: ForkChange,
}

/// Change of an episode from a step on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ForkChange {
    /// The agent's action is left out: it goes on with its task until a tick. All other actions are those of the log, by index, and
    /// the fork ends at the tick at which the episode ended.
    WithoutAction {
        /// Number of the agent.
        agent: usize,
        /// Tick until which the task goes on.
        until: u64,
    },
    /// The satellite, alone, repeats an action until a tick, or until it dies.
    Repeat {
        /// Number of the satellite.
        agent: usize,
        /// Index of the action.
        action: usize,
        /// Tick at which the fork ends.
        until: u64,
    },
    /// The satellite, alone, images a target until a tick at the latest.
    Image {
        /// Number of the satellite.
        agent: usize,
        /// Index of the target.
        target: usize,
        /// Tick at which the fork ends.
        until: u64,
    },
}

/// Result of a fork.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ForkResult {
    /// Outcome of the episode without an action.
    Outcome(EpisodeOutcome),
    /// True if the satellite was alive at the end of a repetition, or stored the image.
    Succeeded(bool),
}

impl ForkResult {
    /// True if a satellite lived or stored its image.
    pub(super) const fn has_succeeded(self) -> bool {
        matches!(self, Self::Succeeded(true))
    }
}

/// Runs forks of an episode. The results are in the order of the requests.
///
/// # Errors
/// Returns an error if the scenario cannot start or the log is not one of this scenario.
pub(super) fn run_forks(
    scenario: &Scenario,
    log: &ActionLog,
    trace: &TaskingTrace,
    requests: &[ForkRequest],
) -> Result<Vec<ForkResult>, ReplayError> {
    let mut results = vec![ForkResult::Succeeded(false); requests.len()];
    let mut order: Vec<usize> = (0..requests.len()).collect();
    order.sort_by_key(|index| requests[*index].step);
    let mut trunk = TaskRun::start(TaskSetup::read(scenario.recipe())?, scenario.seed())?;
    for chunk in order.chunks(TOGETHER) {
        let mut forks = Vec::with_capacity(chunk.len());
        for index in chunk {
            let request = &requests[*index];
            while trunk.sim.steps() + 1 < request.step && !trunk.is_done() {
                let actions = read_step(&mut trunk, log);
                trunk.step(&actions);
            }
            forks.push(Fork::branch(&trunk, request, trace.end()));
        }
        run_together(&mut forks, log);
        for (index, fork) in chunk.iter().zip(forks) {
            results[*index] = fork.result();
        }
    }
    Ok(results)
}

/// Actions of an episode's next step by the log; no actions beyond its end.
fn read_step(run: &mut TaskRun, log: &ActionLog) -> Vec<Option<AgentAction>> {
    let (action, agents) = (log.step(run.sim.steps() as usize), run.sim.len());
    run.read_actions(action).unwrap_or_else(|_| vec![None; agents])
}

/// Runs forks to their ends, step by step.
fn run_together(forks: &mut [Fork], log: &ActionLog) {
    let set = InstructionSet::detect();
    loop {
        let mut active: Vec<&mut Fork> = forks.iter_mut().filter(|fork| !fork.is_over()).collect();
        if active.is_empty() {
            return;
        }
        let actions: Vec<_> = active.iter_mut().map(|fork| fork.next_actions(log)).collect();
        let mut sims: Vec<_> = active.iter_mut().map(|fork| fork.sim()).collect();
        let results = step_all(&mut sims, &actions, set);
        for (fork, result) in active.into_iter().zip(results) {
            fork.finish_step(result);
        }
    }
}

/// A fork that runs.
enum Fork {
    WithoutAction {
        run: Box<TaskRun>,
        /// The agent whose next action is left out, and the tick until which its task goes on.
        skipped: Option<(usize, u64)>,
    },
    Single(Box<SingleFork>),
}

/// A fork of one satellite alone.
struct SingleFork {
    sim: TaskingSim,
    action: AgentAction,
    is_over: bool,
    has_succeeded: bool,
}

impl SingleFork {
    fn new(trunk: &TaskRun, agent: usize, action: AgentAction, until: u64) -> Box<Self> {
        let mut sim = trunk.sim.single(agent);
        sim.end_at(until);
        let is_over = sim.now() >= until;
        Box::new(Self { sim, action, is_over, has_succeeded: false })
    }
}

impl Fork {
    fn branch(trunk: &TaskRun, request: &ForkRequest, end: u64) -> Self {
        match request.change {
            ForkChange::WithoutAction { agent, until } => {
                let mut run = trunk.clone();
                run.sim.end_at(end);
                Self::WithoutAction { run: Box::new(run), skipped: Some((agent, until)) }
            }
            ForkChange::Repeat { agent, action, until } => {
                Self::Single(SingleFork::new(trunk, agent, AgentAction::Index(action), until))
            }
            ForkChange::Image { agent, target, until } => {
                Self::Single(SingleFork::new(trunk, agent, AgentAction::Target(target), until))
            }
        }
    }

    fn is_over(&self) -> bool {
        match self {
            Self::WithoutAction { run, .. } => run.is_done(),
            Self::Single(single) => single.is_over,
        }
    }

    fn sim(&mut self) -> &mut TaskingSim {
        match self {
            Self::WithoutAction { run, .. } => &mut run.sim,
            Self::Single(single) => &mut single.sim,
        }
    }

    fn next_actions(&mut self, log: &ActionLog) -> Vec<Option<AgentAction>> {
        match self {
            Self::WithoutAction { run, skipped } => {
                let mut actions = read_step(run, log);
                if let Some((agent, until)) = skipped.take() {
                    actions[agent] = None;
                    run.sim.go_on_until(agent, until);
                }
                actions
            }
            Self::Single(single) => vec![single.sim.needs_action(0).then_some(single.action)],
        }
    }

    fn finish_step(&mut self, result: Result<StepResult, TaskingError>) {
        match self {
            Self::WithoutAction { run, .. } => run.finish_step(result),
            Self::Single(single) => {
                let Ok(result) = result else {
                    (single.is_over, single.has_succeeded) = (true, false);
                    return;
                };
                let is_alive = single.sim.is_alive(0);
                match single.action {
                    AgentAction::Index(_) => {
                        (single.is_over, single.has_succeeded) = (result.truncated || !is_alive, is_alive);
                    }
                    AgentAction::Target(target) => {
                        (single.is_over, single.has_succeeded) = (true, result.imaged == [Some(target)]);
                    }
                }
            }
        }
    }

    fn result(self) -> ForkResult {
        match self {
            Self::WithoutAction { run, .. } => ForkResult::Outcome(run.outcome()),
            Self::Single(single) => ForkResult::Succeeded(single.has_succeeded),
        }
    }
}
