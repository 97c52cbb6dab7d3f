//! The environments of a batch of docking's episodes.

use std::sync::Arc;

use serde_json::Value;

use super::constants::{EXTENDED_DIM, MAX_DEPUTIES, OBSERVATION_DIM, STEP_S};
use super::setup::{DeputyStarts, DockingSetup};
use super::simulation::DockingSim;
use crate::batch::{
    Batch, BatchConfig, BatchEngine, BatchError, BatchLane, BatchShape, LaneOutput, ObservationMode,
    ObservationPart, PlainWorldErrors, ScenarioSource, check_task,
};
use crate::episode_rng::SeededRng;
use crate::error::ScenarioError;
use crate::scene::Scene;
use crate::seed::{Seed, SeedSpace};
use crate::task::{Recipe, Scenario, TaskSpec};

/// Number of values of one deputy's action.
const ACTION_DIM: usize = 3;

/// Errors of settings that the world does not have.
const UNSUPPORTED: PlainWorldErrors = PlainWorldErrors {
    observe: "docking supports only the observation modes `all`, without bodies, and `extended`: a deputy observes only itself",
    axes: "docking supports only actions along the world's axes: a deputy has no axes of its own",
    mixed_tasks: "docking supports only batches of one task: its tasks differ in their number of agents",
};

/// Names of the values of a deputy's extended observation; the first eight are those of its observation.
const COLUMN_NAMES: [&str; EXTENDED_DIM] = [
    "x",
    "y",
    "z",
    "vx",
    "vy",
    "vz",
    "speed",
    "speed_limit",
    "time_left",
    "time_left_share",
    "log_thrust_bound",
    "log_distance",
    "direction_x",
    "direction_y",
    "direction_z",
    "vx_ratio",
    "vy_ratio",
    "vz_ratio",
    "speed_ratio",
    "speed_ratio_along",
];

/// Creates a batch of a task's episodes. It has room for the deputies of the source's single recipe, or else for the
/// largest number that the task allows. A deputy that a scenario lacks counts as terminated from its start.
pub(super) fn create_batch(
    task: &dyn TaskSpec,
    source: Box<dyn ScenarioSource>,
    config: BatchConfig,
) -> Result<Box<dyn Batch>, BatchError> {
    let is_extended = config.observe == ObservationMode::Extended;
    let plain = ObservationMode::All { bodies: None };
    BatchConfig { observe: if is_extended { plain } else { config.observe }, ..config }
        .check_plain(&UNSUPPORTED)?;
    let (id, space) = (task.id(), task.params());
    let first = source.scenario(0, 0);
    let setup = read_setup(id, first.recipe()).map_err(|source| BatchError::Scenario { env: 0, source })?;
    let max_deputies = || space.iter().find(|param| param.name == "deputies").map_or(1, |p| p.max as usize);
    let agents = source.single_recipe().map_or_else(max_deputies, |_| setup.deputies);
    let width = if is_extended { EXTENDED_DIM } else { OBSERVATION_DIM };
    let shape = BatchShape { envs: config.envs, agents, action: ACTION_DIM, observation: agents * width };
    let start = DeputyStarts::at_chief(setup.deputies, setup.time_limit);
    let lane = || DockingLane {
        task: id,
        sim: DockingSim::new(setup, &start),
        rng: SeededRng::new(Seed::in_space(SeedSpace::User, 0)),
        recipe: Arc::clone(first.recipe()),
        agents,
        is_extended,
    };
    Ok(Box::new(BatchEngine::new(config, shape, task.action_space(), source, lane)?))
}

/// Reads a recipe of this task.
fn read_setup(task: &str, recipe: &Recipe) -> Result<DockingSetup, ScenarioError> {
    check_task(task, recipe)?;
    DockingSetup::read(recipe)
}

/// One environment of a batch.
struct DockingLane {
    task: &'static str,
    sim: DockingSim,
    rng: SeededRng,
    /// Recipe from which the simulation's setup was read.
    recipe: Arc<Recipe>,
    agents: usize,
    /// True if observations have the further values.
    is_extended: bool,
}

impl DockingLane {
    /// Number of values of a deputy's observation.
    const fn width(&self) -> usize {
        if self.is_extended { EXTENDED_DIM } else { OBSERVATION_DIM }
    }
}

impl BatchLane for DockingLane {
    fn start(&mut self, scenario: &Scenario) -> Result<(), ScenarioError> {
        let recipe = scenario.recipe();
        if !Arc::ptr_eq(recipe, &self.recipe) {
            let setup = read_setup(self.task, recipe)?;
            // Only if the source has more than the single recipe that it declared.
            if setup.deputies > self.agents {
                return Err(ScenarioError::OutOfRange {
                    field: "params.deputies".to_owned(),
                    value: setup.deputies as f64,
                    min: 1.0,
                    max: self.agents as f64,
                });
            }
            self.sim.set_setup(setup);
            self.recipe = Arc::clone(recipe);
        }
        self.rng.reseed(scenario.seed());
        let start = self.sim.setup().sample_starts(&mut self.rng)?;
        self.sim.reset(&start);
        Ok(())
    }

    #[expect(clippy::cast_possible_truncation, reason = "rewards are single precision here")]
    fn step(&mut self, actions: &[f32], out: LaneOutput<'_>) -> bool {
        let mut thrusts = [[0.0; ACTION_DIM]; MAX_DEPUTIES];
        for (thrust, action) in thrusts.iter_mut().zip(actions.chunks_exact(ACTION_DIM)) {
            for (axis, value) in thrust.iter_mut().zip(action) {
                *axis = f64::from(*value);
            }
        }
        if !out.executed_actions.is_empty() {
            out.executed_actions.copy_from_slice(actions);
        }
        let step = self.sim.apply_thrusts(thrusts);
        *out.team_reward = step.reward as f32;
        let live = self.sim.active_deputies();
        for (agent, live) in live.into_iter().enumerate().take(self.agents) {
            let before = step.active_before[agent];
            out.rewards[agent] = if before { step.rewards[agent].total() as f32 } else { 0.0 };
            // A timeout is both, as in `DockingEpisode`.
            out.terminated[agent] = !live;
            out.truncated[agent] =
                before && self.sim.deputies().get(agent).is_some_and(|d| d.end_conditions.timeout);
        }
        out.elapsed.fill(STEP_S as f32);
        step.done
    }

    fn mark_absent_agents(&self, terminated: &mut [bool]) {
        let present = self.sim.deputies().len();
        terminated.iter_mut().enumerate().for_each(|(agent, absent)| *absent = agent >= present);
    }

    fn needs_action(&self, out: &mut [bool]) {
        out.fill(false);
        out.iter_mut().zip(self.sim.active_deputies()).for_each(|(needs_action, live)| *needs_action = live);
    }

    fn observe(&mut self, out: &mut [f32]) {
        if self.is_extended {
            self.sim.observe_extended_into(out);
        } else {
            self.sim.observe_into(out);
        }
    }

    fn score(&self) -> f64 {
        self.sim.outcome().score
    }

    fn scene(&self, actions: &[f32]) -> Scene {
        super::scene::build_scene(&self.sim, actions)
    }

    fn telemetry(&self) -> Value {
        serde_json::to_value(self.sim.telemetry(&[], 0.0)).unwrap_or(Value::Null)
    }

    fn alerts(&self) -> Vec<String> {
        self.sim.events().iter().map(super::event::DockingEvent::alert).collect()
    }

    fn state_hash(&self) -> [u8; 32] {
        self.sim.state_hash()
    }

    fn columns(&self) -> Vec<String> {
        let names = &COLUMN_NAMES[..self.width()];
        (0..self.agents)
            .flat_map(|deputy| names.iter().map(move |name| format!("deputy_{deputy}_{name}")))
            .collect()
    }

    fn parts(&self) -> Vec<ObservationPart> {
        vec![ObservationPart { name: "deputies", shape: vec![self.agents, self.width()] }]
    }

    fn bytes(&self) -> usize {
        self.sim.memory_bytes() + self.rng.bytes() + size_of::<Self>() - size_of::<DockingSim>()
    }
}
