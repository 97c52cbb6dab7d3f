//! kessler, stepped through its own engine: observations are written as f32 after every step and reset.

use std::hint::black_box;

use env_core::chance::Seeded;
use env_core::kessler::constants::{FRAGMENTS, SATELLITES};
use env_core::kessler::flight::Flight;
use env_core::kessler::setup::{Setup, Start};
use env_core::kessler::{Kessler, TASKS};
use env_core::world::BenchSpec;
use env_core::{Recipe, TaskSpec};

use super::actions::Actions;
use super::{Stepper, seed};

/// One environment and what it is flown with.
pub(super) struct Engine {
    setup: Setup,
    flight: Flight<Seeded>,
    actions: Actions,
    episodes: u64,
    observation: Vec<f32>,
}

impl Engine {
    pub(super) fn new(spec: BenchSpec) -> anyhow::Result<Self> {
        let [first, ..] = &TASKS;
        let task: &'static Kessler = TASKS.iter().find(|task| task.id() == spec.task).unwrap_or(first);
        let recipe = Recipe::with_params(task, spec.params.iter().copied())?;
        let setup = Setup::read(&recipe)?;
        let (start, chance) = start(&setup, 0)?;
        let bodies = start.debris.len() + SATELLITES * FRAGMENTS;
        let mut engine = Self {
            flight: Flight::new(task.objective(), setup.clone(), start, chance),
            setup,
            actions: Actions::draw(SATELLITES as u32, task.action_space().columns.len(), spec.action),
            episodes: 1,
            observation: vec![0.0; SATELLITES * 6 + bodies * 5],
        };
        engine.look();
        Ok(engine)
    }

    fn look(&mut self) {
        self.flight.observe_into(&mut self.observation);
        black_box(&self.observation);
    }
}

impl Stepper for Engine {
    fn step(&mut self) -> anyhow::Result<bool> {
        let stepped = self.flight.step(black_box(self.actions.next()))?;
        self.look();
        if stepped.done {
            let (start, chance) = start(&self.setup, self.episodes)?;
            self.flight.restart(start, chance);
            self.episodes += 1;
            self.look();
        }
        Ok(stepped.done)
    }
}

fn start(setup: &Setup, episode: u64) -> anyhow::Result<(Start, Seeded)> {
    let mut chance = Seeded::new(seed(episode));
    Ok((setup.start(&mut chance)?, chance))
}
