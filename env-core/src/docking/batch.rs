//! docking as lanes of a batch.

use std::sync::Arc;

use super::constants::{MAX_DEPUTIES, OBSERVATION};
use super::flight::Flight;
use super::setup::{Setup, Start};
use crate::batch::{Batch, BatchConfig, BatchError, Engine, Feed, Lane, LaneOutput, Observe, Shape};
use crate::chance::Seeded;
use crate::error::ScenarioError;
use crate::scenario::Recipe;
use crate::seed::{Seed, SeedSpace};

/// Values of one deputy's action.
const ACTION: usize = 3;

/// A batch of this task's episodes, with room for as many deputies as slot 0's first scenario has.
pub(super) fn batch(
    task: &'static str,
    feed: Box<dyn Feed>,
    config: BatchConfig,
) -> Result<Box<dyn Batch>, BatchError> {
    if config.observe != (Observe::All { bodies: None }) {
        return Err(BatchError::Unsupported(
            "a deputy sees itself and nothing else: docking observes everything, and no bodies",
        ));
    }
    let fault = |source| BatchError::Scenario { env: 0, source };
    let (recipe, seed) = feed.scenario(0, 0);
    let setup = Setup::read(&recipe).map_err(fault)?;
    let mut chance = Seeded::new(seed);
    let start = setup.start(&mut chance).map_err(fault)?;
    let agents = start.deputies.clamp(1, MAX_DEPUTIES);
    let shape = Shape { envs: config.envs, agents, action: ACTION, observation: agents * OBSERVATION };
    let lane = || DockingLane {
        task,
        flight: Flight::new(setup, &start),
        chance: Seeded::new(Seed::in_space(SeedSpace::User, 0)),
        recipe: Arc::clone(&recipe),
        agents,
    };
    Ok(Box::new(Engine::new(config, shape, feed, lane)?))
}

struct DockingLane {
    task: &'static str,
    flight: Flight,
    chance: Seeded,
    /// What the flight's setup was read from.
    recipe: Arc<Recipe>,
    agents: usize,
}

impl DockingLane {
    fn read(&mut self, recipe: &Arc<Recipe>) -> Result<(), ScenarioError> {
        if recipe.task().id() != self.task {
            return Err(ScenarioError::UnknownChoice {
                field: "task".to_owned(),
                value: recipe.task().id().to_owned(),
                choices: self.task.to_owned(),
            });
        }
        self.flight.set_up(Setup::read(recipe)?);
        self.recipe = Arc::clone(recipe);
        Ok(())
    }
}

impl Lane for DockingLane {
    fn start(&mut self, recipe: &Arc<Recipe>, seed: Seed) -> Result<(), ScenarioError> {
        if !Arc::ptr_eq(recipe, &self.recipe) {
            self.read(recipe)?;
        }
        self.chance.reseed(seed);
        let start: Start = self.flight.setup().start(&mut self.chance)?;
        if start.deputies > self.agents {
            return Err(ScenarioError::Layout {
                field: "params.deputies".to_owned(),
                reason: format!("{} deputies; this batch has room for {}", start.deputies, self.agents),
            });
        }
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

    fn observe(&mut self, out: &mut [f32]) {
        self.flight.observe_into(out);
    }

    fn score(&self) -> f64 {
        self.flight.flown().score
    }

    fn state_hash(&self) -> [u8; 32] {
        self.flight.state_hash()
    }

    fn bytes(&self) -> usize {
        self.flight.bytes() + self.chance.bytes() + size_of::<Self>() - size_of::<Flight>()
    }
}
