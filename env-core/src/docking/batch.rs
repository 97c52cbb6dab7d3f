//! docking as lanes of a batch.

use std::sync::Arc;

use serde_json::Value;

use super::Docking;
use super::constants::{MAX_DEPUTIES, OBSERVATION, STATE};
use super::flight::Flight;
use super::setup::{Setup, Start};
use crate::batch::{
    Axes, Batch, BatchConfig, BatchError, Engine, Feed, Lane, LaneOutput, Observe, Shape, of_task,
};
use crate::chance::Seeded;
use crate::error::ScenarioError;
use crate::scenario::Recipe;
use crate::scene::Scene;
use crate::seed::{Seed, SeedSpace};
use crate::task::TaskSpec;

/// Values of one deputy's action.
const ACTION: usize = 3;

/// A batch of this task's episodes, with room for as many deputies as the feed's only recipe has, or as any can. Who is
/// absent from a scenario has left from its start.
pub(super) fn batch(
    task: &Docking,
    feed: Box<dyn Feed>,
    config: BatchConfig,
) -> Result<Box<dyn Batch>, BatchError> {
    if config.observe != (Observe::All { bodies: None }) {
        return Err(BatchError::Unsupported(
            "a deputy sees itself and nothing else: docking observes everything, and no bodies",
        ));
    }
    if config.axes != Axes::World {
        return Err(BatchError::Unsupported(
            "a deputy has no axes of its own: docking's actions are along the chief's",
        ));
    }
    if config.mixed {
        return Err(BatchError::Unsupported(
            "docking's tasks differ in their agents: a batch is of one of them",
        ));
    }
    let (id, space) = (task.id(), task.params());
    let (recipe, _) = feed.scenario(0, 0);
    let setup = read(id, &recipe).map_err(|source| BatchError::Scenario { env: 0, source })?;
    let most = || space.iter().find(|param| param.name == "deputies").map_or(1, |p| p.max as usize);
    let agents = feed.only().map_or_else(most, |_| setup.deputies);
    let shape = Shape { envs: config.envs, agents, action: ACTION, observation: agents * OBSERVATION };
    let start = Start { deputies: setup.deputies, states: [[0.0; STATE]; MAX_DEPUTIES] };
    let lane = || DockingLane {
        task: id,
        flight: Flight::new(setup, &start),
        chance: Seeded::new(Seed::in_space(SeedSpace::User, 0)),
        recipe: Arc::clone(&recipe),
        agents,
    };
    Ok(Box::new(Engine::new(config, shape, feed, lane)?))
}

/// A recipe of this task, in docking's terms.
fn read(task: &str, recipe: &Recipe) -> Result<Setup, ScenarioError> {
    of_task(task, recipe)?;
    Setup::read(recipe)
}

struct DockingLane {
    task: &'static str,
    flight: Flight,
    chance: Seeded,
    /// What the flight's setup was read from.
    recipe: Arc<Recipe>,
    agents: usize,
}

impl Lane for DockingLane {
    fn start(&mut self, recipe: &Arc<Recipe>, seed: Seed) -> Result<(), ScenarioError> {
        if !Arc::ptr_eq(recipe, &self.recipe) {
            let setup = read(self.task, recipe)?;
            // Only where the feed broke its word, that there is one recipe.
            if setup.deputies > self.agents {
                return Err(ScenarioError::OutOfRange {
                    field: "params.deputies".to_owned(),
                    value: setup.deputies as f64,
                    min: 1.0,
                    max: self.agents as f64,
                });
            }
            self.flight.set_up(setup);
            self.recipe = Arc::clone(recipe);
        }
        self.chance.reseed(seed);
        let start = self.flight.setup().start(&mut self.chance)?;
        self.flight.restart(&start);
        Ok(())
    }

    #[expect(clippy::cast_possible_truncation, reason = "rewards are single precision here")]
    fn step(&mut self, actions: &[f32], out: LaneOutput<'_>) -> bool {
        let mut thrusts = [[0.0; ACTION]; MAX_DEPUTIES];
        for (thrust, action) in thrusts.iter_mut().zip(actions.chunks_exact(ACTION)) {
            for (axis, value) in thrust.iter_mut().zip(action) {
                *axis = f64::from(*value);
            }
        }
        if !out.taken.is_empty() {
            out.taken.copy_from_slice(actions);
        }
        let stepped = self.flight.fly(thrusts);
        *out.team_reward = stepped.reward as f32;
        let live = self.flight.live();
        for (agent, live) in live.into_iter().enumerate().take(self.agents) {
            let before = stepped.live_before[agent];
            out.rewards[agent] = if before { stepped.rewards[agent].total() as f32 } else { 0.0 };
            // As the episode has it: time running out is both.
            out.terminated[agent] = !live;
            out.truncated[agent] =
                before && self.flight.deputies().get(agent).is_some_and(|d| d.ends.timeout);
        }
        stepped.done
    }

    fn absent(&self, terminated: &mut [bool]) {
        let present = self.flight.deputies().len();
        terminated.iter_mut().enumerate().for_each(|(agent, absent)| *absent = agent >= present);
    }

    fn observe(&mut self, out: &mut [f32]) {
        self.flight.observe_into(out);
    }

    fn score(&self) -> f64 {
        self.flight.flown().score
    }

    fn scene(&self, acted: &[f32]) -> Scene {
        super::scene::scene(&self.flight, acted)
    }

    fn telemetry(&self) -> Value {
        serde_json::to_value(self.flight.telemetry(&[], 0.0)).unwrap_or(Value::Null)
    }

    fn alerts(&self) -> Vec<String> {
        self.flight.events().iter().map(super::event::Event::alert).collect()
    }

    fn state_hash(&self) -> [u8; 32] {
        self.flight.state_hash()
    }

    fn columns(&self) -> Vec<String> {
        let names = ["x", "y", "z", "vx", "vy", "vz", "speed", "speed_limit"];
        (0..self.agents).flat_map(|deputy| names.map(|name| format!("deputy_{deputy}_{name}"))).collect()
    }

    fn bytes(&self) -> usize {
        self.flight.bytes() + self.chance.bytes() + size_of::<Self>() - size_of::<Flight>()
    }
}
