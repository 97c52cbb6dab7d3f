//! Any world, stepped through the contract that every task answers to.

use std::hint::black_box;
use std::sync::Arc;

use anyhow::Context;
use env_core::task::StepReport;
use env_core::world::BenchSpec;
use env_core::{Episode, Recipe, Scenario};

use super::actions::Actions;
use super::{Stepper, seed};

/// One environment and what it is flown with.
pub(super) struct ByContract {
    recipe: Arc<Recipe>,
    episode: Box<dyn Episode>,
    actions: Actions,
    report: StepReport,
    /// Episodes begun.
    begun: u64,
}

/// Starts tried for one that is fair.
const STARTS: u64 = 1000;

impl ByContract {
    pub(super) fn new(spec: BenchSpec) -> anyhow::Result<Self> {
        let task = env_core::task(spec.task).with_context(|| format!("{} is gone", spec.task))?;
        let recipe = Arc::new(Recipe::with_params(task, spec.params.iter().copied())?);
        let agents = task.agents(&recipe);
        let columns = task.action_space().columns.len();
        let mut begun = 0;
        Ok(Self {
            episode: start(&recipe, &mut begun)?,
            recipe,
            actions: Actions::draw(agents, columns, spec.action),
            report: StepReport::default(),
            begun,
        })
    }
}

impl Stepper for ByContract {
    fn step(&mut self) -> anyhow::Result<bool> {
        self.episode.step(black_box(self.actions.next()), &mut self.report)?;
        let _ = black_box(self.episode.observation());
        let done = self.report.done;
        if done {
            self.episode = start(&self.recipe, &mut self.begun)?;
            let _ = black_box(self.episode.observation());
        }
        Ok(done)
    }
}

/// The next episode whose start is fair.
fn start(recipe: &Arc<Recipe>, begun: &mut u64) -> anyhow::Result<Box<dyn Episode>> {
    let mut fault = None;
    for _ in 0..STARTS {
        let scenario = Scenario::new(Arc::clone(recipe), seed(*begun));
        *begun += 1;
        match recipe.task().start(&scenario) {
            Ok(episode) => return Ok(episode),
            Err(error) => fault = Some(error),
        }
    }
    Err(fault.map_or_else(|| anyhow::anyhow!("nothing was tried"), Into::into))
}
