//! The environments of a batch of the tasks' episodes.

use std::sync::Arc;

use serde_json::Value;

use super::run::TaskRun;
use super::task_setup::{MAX_SATELLITES, TaskSetup};
use crate::batch::{
    Batch, BatchConfig, BatchEngine, BatchError, BatchLane, BatchShape, LaneOutput, LaneStep,
    ObservationPart, PlainWorldErrors, ScenarioSource, check_task,
};
use crate::error::ScenarioError;
use crate::scene::Scene;
use crate::space::ActionSpace;
use crate::task::{Recipe, Scenario, TaskSpec};
use crate::tasking::simulation::{AgentAction, step_all};
use crate::tasking::tick::dispatch::InstructionSet;

/// Errors of settings that the world does not have.
const UNSUPPORTED: PlainWorldErrors = PlainWorldErrors {
    observe: "tasking supports only the observation mode `all`, without bodies: a satellite observes itself and its opportunities",
    axes: "tasking supports only actions along the world's axes: its actions are indices",
    mixed_tasks: "tasking supports only batches of one task: its tasks differ in their actions",
};

/// Creates a batch of a task's episodes. It has room for the satellites of the source's single recipe, or else for the largest number
/// of the task. A satellite that a scenario lacks counts as terminated from its start.
pub(super) fn create_batch(
    task: &dyn TaskSpec,
    source: Box<dyn ScenarioSource>,
    config: BatchConfig,
) -> Result<Box<dyn Batch>, BatchError> {
    config.check_plain(&UNSUPPORTED)?;
    let first = source.scenario(0, 0);
    let refused = |source| BatchError::Scenario { env: 0, source };
    let setup = read_setup(task.id(), first.recipe()).map_err(refused)?;
    let run = TaskRun::start(setup.clone(), first.seed()).map_err(refused)?;
    let has_more = task.params().iter().any(|param| param.name == "satellites");
    let largest = if has_more { MAX_SATELLITES } else { 1 };
    let agents = source.single_recipe().map_or(largest, |_| setup.satellites());
    let columns = Arc::new(run.sim.observation_columns(0));
    let actions = task.action_space();
    let shape =
        BatchShape { envs: config.envs, agents, action: actions.dim(), observation: agents * columns.len() };
    let lane = || TaskingLane {
        task: task.id(),
        setup: setup.clone(),
        recipe: Arc::clone(first.recipe()),
        run: run.clone(),
        agents,
        columns: Arc::clone(&columns),
        memory: Vec::new(),
    };
    Ok(Box::new(BatchEngine::new(config, shape, actions, source, lane)?))
}

/// Reads a recipe of this task.
fn read_setup(task: &str, recipe: &Recipe) -> Result<TaskSetup, ScenarioError> {
    check_task(task, recipe)?;
    TaskSetup::read(recipe)
}

/// One environment of a batch.
struct TaskingLane {
    task: &'static str,
    setup: TaskSetup,
    /// Recipe from which the set-up was read.
    recipe: Arc<Recipe>,
    run: TaskRun,
    agents: usize,
    columns: Arc<Vec<String>>,
    /// Memory for an observation.
    memory: Vec<f64>,
}

impl TaskingLane {
    /// Actions of the simulation by the indices of all agents.
    fn choose(&mut self, actions: &[f32]) -> Vec<Option<AgentAction>> {
        self.run.choose(|agent| {
            let action = actions.get(agent).copied().unwrap_or(ActionSpace::GO_ON);
            (action >= 0.0).then_some(action as usize)
        })
    }

    /// Writes the result of the last step, and returns true if the episode is over.
    fn write_step(&self, actions: &[f32], out: LaneOutput<'_>) -> bool {
        let LaneOutput { rewards, team_reward, terminated, truncated, elapsed, executed_actions } = out;
        if !executed_actions.is_empty() {
            executed_actions.copy_from_slice(actions);
        }
        let (done, last) = (self.run.is_done(), self.run.last_step());
        *team_reward = last.reward as f32;
        elapsed.fill(last.elapsed_s as f32);
        for agent in 0..self.agents {
            let is_dead = self.run.is_dead(agent);
            rewards[agent] = last.rewards.get(agent).map_or(0.0, |reward| *reward as f32);
            terminated[agent] = is_dead;
            truncated[agent] = !is_dead && self.run.is_truncated();
        }
        done
    }
}

impl BatchLane for TaskingLane {
    fn start(&mut self, scenario: &Scenario) -> Result<(), ScenarioError> {
        let recipe = scenario.recipe();
        if !Arc::ptr_eq(recipe, &self.recipe) {
            let setup = read_setup(self.task, recipe)?;
            // Only if the source has more than the single recipe that it declared.
            if setup.satellites() > self.agents {
                return Err(ScenarioError::OutOfRange {
                    field: "params.satellites".to_owned(),
                    value: setup.satellites() as f64,
                    min: 1.0,
                    max: self.agents as f64,
                });
            }
            self.setup = setup;
            self.recipe = Arc::clone(recipe);
        }
        self.run = TaskRun::start(self.setup.clone(), scenario.seed())?;
        Ok(())
    }

    fn step(&mut self, actions: &[f32], out: LaneOutput<'_>) -> bool {
        let chosen = self.choose(actions);
        self.run.step(&chosen);
        self.write_step(actions, out)
    }

    /// Runs the ticks of all episodes side by side.
    fn step_many<'a, T>(
        steps: impl Iterator<Item = (LaneStep<'a, Self>, T)>,
        mut finish: impl FnMut(&'a mut Self, bool, T),
    ) where
        Self: 'a,
    {
        let mut steps: Vec<_> = steps.collect();
        let actions: Vec<_> = steps.iter_mut().map(|(step, _)| step.lane.choose(step.actions)).collect();
        let mut sims: Vec<_> = steps.iter_mut().map(|(step, _)| &mut step.lane.run.sim).collect();
        let results = step_all(&mut sims, &actions, InstructionSet::detect());
        for ((LaneStep { lane, actions, out }, value), result) in steps.into_iter().zip(results) {
            lane.run.finish_step(result);
            let done = lane.write_step(actions, out);
            finish(lane, done, value);
        }
    }

    fn mark_absent_agents(&self, terminated: &mut [bool]) {
        let present = self.run.sim.len();
        terminated.iter_mut().enumerate().for_each(|(agent, absent)| *absent = agent >= present);
    }

    fn needs_action(&self, out: &mut [bool]) {
        out.iter_mut().enumerate().for_each(|(agent, needs)| *needs = self.run.needs_action(agent));
    }

    fn observe(&mut self, out: &mut [f32]) {
        self.run.observe(&mut self.memory, out, self.agents);
    }

    fn score(&self) -> f64 {
        self.run.outcome().score
    }

    fn state_hash(&self) -> [u8; 32] {
        self.run.sim.state_hash()
    }

    fn scene(&self, _: &[f32]) -> Scene {
        super::scene::build_scene(&self.run)
    }

    fn alerts(&self) -> Vec<String> {
        self.run.alerts()
    }

    fn telemetry(&self) -> Value {
        serde_json::to_value(self.run.clone().telemetry()).unwrap_or(Value::Null)
    }

    fn columns(&self) -> Vec<String> {
        let columns = |agent: usize| self.columns.iter().map(move |name| format!("satellite_{agent}_{name}"));
        (0..self.agents).flat_map(columns).collect()
    }

    fn parts(&self) -> Vec<ObservationPart> {
        vec![ObservationPart { name: "satellites", shape: vec![self.agents, self.columns.len()] }]
    }

    fn bytes(&self) -> usize {
        size_of::<Self>() + self.run.sim.memory_bytes()
    }
}
