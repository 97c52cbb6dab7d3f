//! What a reset asks for, tried by one environment beside before anything moves.

use std::sync::Arc;

use env_core::batch::{Batch, BatchConfig, BatchError};
use env_core::seed::SeedSpace;
use env_core::{Recipe, Seed, TaskSpec};
use pyo3::exceptions::{PyMemoryError, PyValueError};
use pyo3::prelude::*;

use super::NativeBatch;
use super::parts::read_seed;
use crate::errors::{self, invalid};
use crate::feed::{Fed, Row, Rows, Wish};
use crate::scenario::NativeScenario;

impl NativeBatch {
    /// What a reset asks of each environment: nothing, or one wish for each.
    ///
    /// # Errors
    /// What is none, with the field.
    pub(super) fn wishes(
        &self,
        seeds: &[Option<Bound<'_, PyAny>>],
        recipes: Option<Vec<Option<NativeScenario>>>,
        scenarios: Option<Vec<Option<NativeScenario>>>,
    ) -> PyResult<Vec<Wish>> {
        let (envs, recipes, scenarios) =
            (self.shape.envs, recipes.unwrap_or_default(), scenarios.unwrap_or_default());
        let mut wishes = vec![Wish::default(); envs];
        for (field, found) in
            [("seed", seeds.len()), ("options", recipes.len()), ("options.scenario", scenarios.len())]
        {
            if found != 0 && found != envs {
                return Err(invalid(field, format!("{found} for {envs} environments")));
            }
        }
        for (wish, seed) in wishes.iter_mut().zip(seeds) {
            wish.seed = seed.as_ref().map(read_seed).transpose()?;
        }
        for (wish, recipe) in wishes.iter_mut().zip(recipes) {
            recipe.iter().try_for_each(|recipe| self.of_task(recipe))?;
            wish.recipe = recipe.map(|NativeScenario(recipe)| Arc::clone(recipe.recipe()));
        }
        for (wish, scenario) in wishes.iter_mut().zip(scenarios) {
            scenario.iter().try_for_each(|scenario| self.of_task(scenario))?;
            wish.once = scenario.map(|NativeScenario(scenario)| scenario);
            if let Some(once) = &wish.once {
                Seed::user(once.seed().get()).map_err(|error| errors::scenario(&error))?;
            }
        }
        Ok(wishes)
    }

    /// The rows that come of these wishes, once one environment has begun what is new of them: what cannot be begun must not
    /// end what is being flown.
    ///
    /// # Errors
    /// A start that is not fair, or more agents than there is room for.
    pub(super) fn wished(&self, wishes: Vec<Wish>, mask: Option<&[bool]>) -> PyResult<Vec<(usize, Row)>> {
        let mut trial = None;
        let mut rows = Vec::new();
        for (slot, wish) in wishes.into_iter().enumerate() {
            if wish.is_empty() || mask.is_some_and(|mask| !mask[slot]) {
                continue;
            }
            let row = wish.of(&self.rows.row(slot));
            if wish.recipe.is_some() || wish.once.is_some() {
                let trial = match &mut trial {
                    Some(trial) => trial,
                    none => none.insert(Trial::new(self.task, &self.recipe, self.config)?),
                };
                trial.begin(slot, row.clone(), &wish)?;
            }
            rows.push((slot, row));
        }
        Ok(rows)
    }

    /// A curriculum says what is flown, and nobody else.
    fn of_task(&self, NativeScenario(scenario): &NativeScenario) -> PyResult<()> {
        if self.desk.is_some() {
            return Err(invalid("options", "the curriculum says what is flown"));
        }
        let (task, mine) = (scenario.task().id(), self.task.id());
        if task == mine { Ok(()) } else { Err(invalid("scenario", format!("one of {task}, not of {mine}"))) }
    }
}

/// One environment, in which others' next scenarios are tried.
struct Trial {
    rows: Arc<Rows>,
    one: Box<dyn Batch>,
    seen: Vec<f32>,
}

impl Trial {
    fn new(task: &'static dyn TaskSpec, recipe: &Arc<Recipe>, config: BatchConfig) -> PyResult<Self> {
        let rows = Rows::new(1, Arc::clone(recipe), |_| Seed::in_space(SeedSpace::User, 0));
        let one = task.batch(Box::new(Fed(Arc::clone(&rows))), BatchConfig { envs: 1, ..config });
        let one = one.map_err(|error| PyValueError::new_err(error.to_string()))?;
        let seen = vec![0.0; one.shape().observation];
        Ok(Self { rows, one, seen })
    }

    fn begin(&mut self, slot: usize, row: Row, wish: &Wish) -> PyResult<()> {
        self.rows.put(0, row);
        self.one.reset(None, &mut self.seen).map_err(|error| match error {
            BatchError::Scenario { source, .. } => {
                let words = "environments have room for what they were made with, and start fairly";
                invalid("options", format!("{source}; {words} (environment {slot})"))
            }
            other => PyValueError::new_err(other.to_string()),
        })?;
        let flies = self.one.episode(0).map(|(scenario, _)| scenario);
        if wish.once.as_ref().is_some_and(|once| flies.as_ref() != Some(once)) {
            return Err(invalid("options.scenario", "it has no fair start"));
        }
        Ok(())
    }

    /// Bytes that one such environment takes, its observation and the last of an episode that ends among them.
    fn bytes(&mut self) -> usize {
        // What has no fair start is told by the reset that asks for it.
        let _ = self.one.reset(None, &mut self.seen);
        self.one.bytes_per_env() + 2 * size_of_val(self.seen.as_slice())
    }
}

/// Many environments from here on: one that is refused is better than a program that is ended for want of memory.
const MANY: usize = 4096;

/// Whether there is memory for so many environments, by what one takes.
///
/// # Errors
/// `MemoryError`, with how much they take.
pub(super) fn fits(task: &'static dyn TaskSpec, recipe: &Arc<Recipe>, config: BatchConfig) -> PyResult<()> {
    if config.envs < MANY {
        return Ok(());
    }
    let all = config.envs.saturating_mul(Trial::new(task, recipe, config)?.bytes());
    let mut room = Vec::<u8>::new();
    let found = room.try_reserve_exact(all);
    std::hint::black_box(&room); // what is never looked at need not be reserved
    found.map_err(|_| {
        let (envs, gib) = (config.envs, all as f64 / f64::from(1 << 30));
        PyMemoryError::new_err(format!(
            "num_envs: {envs} environments take {gib:.1} GiB, and there is not as much"
        ))
    })
}
