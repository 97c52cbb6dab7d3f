//! Which scenario an environment flies next: a row of its own for each, begun by a seed, so that environment k of a batch that
//! was reset with seed s flies what a single environment flies that was reset with seed s + k.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use env_core::batch::{Feed, nth_seed};
use env_core::{Recipe, Seed};

/// One environment's row.
struct Row {
    recipe: Arc<Recipe>,
    seed: Seed,
    /// Scenarios begun since the seed was set.
    begun: u64,
}

/// The rows of all environments.
pub(crate) struct Rows {
    rows: Vec<Mutex<Row>>,
    recipe: Arc<Recipe>,
}

fn held(row: &Mutex<Row>) -> MutexGuard<'_, Row> {
    // Nothing that holds it can panic; if something did, the row still is one.
    row.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Rows {
    pub(crate) fn new(envs: usize, recipe: Arc<Recipe>, seed: impl Fn(usize) -> Seed) -> Arc<Self> {
        let row = |slot| Mutex::new(Row { recipe: Arc::clone(&recipe), seed: seed(slot), begun: 0 });
        Arc::new(Self { rows: (0..envs).map(row).collect(), recipe })
    }

    /// The row of an environment begins again: its next scenario is that of this seed itself.
    pub(crate) fn seed(&self, slot: usize, seed: Seed) {
        let mut row = held(&self.rows[slot]);
        (row.seed, row.begun) = (seed, 0);
    }

    /// What an environment flies from its next scenario on; without a recipe, what all were made with.
    pub(crate) fn set(&self, slot: usize, recipe: Option<&Arc<Recipe>>) {
        held(&self.rows[slot]).recipe = Arc::clone(recipe.unwrap_or(&self.recipe));
    }

    /// Forgets what was begun: a batch looks at the first scenario before it begins any.
    pub(crate) fn rewind(&self) {
        self.rows.iter().for_each(|row| held(row).begun = 0);
    }
}

/// The rows as a batch is fed with them.
pub(crate) struct Fed(pub(crate) Arc<Rows>);

impl Feed for Fed {
    fn scenario(&self, slot: usize, _: u64) -> (Arc<Recipe>, Seed) {
        let mut row = held(&self.0.rows[slot]);
        let number = row.begun;
        row.begun += 1;
        let seed = if number == 0 { row.seed } else { nth_seed(row.seed.get(), 0, number) };
        (Arc::clone(&row.recipe), seed)
    }

    fn only(&self) -> Option<&Arc<Recipe>> {
        Some(&self.0.recipe)
    }
}
