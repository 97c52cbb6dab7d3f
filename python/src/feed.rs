//! Which scenario an environment flies next: a row of its own for each, begun by a seed, so that environment k of a batch that
//! was reset with seed s flies what a single environment flies that was reset with seed s + k.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use env_core::batch::{Feed, nth_seed};
use env_core::{Recipe, Scenario, Seed};

/// One environment's row.
#[derive(Clone)]
pub(crate) struct Row {
    recipe: Arc<Recipe>,
    seed: Seed,
    /// Scenarios begun since the seed was set.
    begun: u64,
    /// A scenario that is flown before the row goes on.
    once: Option<(Arc<Recipe>, Seed)>,
}

/// What a reset asks of an environment.
#[derive(Clone, Default)]
pub(crate) struct Wish {
    /// The row begins again: its next scenario is that of this seed itself.
    pub(crate) seed: Option<Seed>,
    /// What is flown from here on.
    pub(crate) recipe: Option<Arc<Recipe>>,
    /// What is flown before the row goes on.
    pub(crate) once: Option<Scenario>,
}

impl Wish {
    /// The row goes on as it was.
    pub(crate) const fn is_empty(&self) -> bool {
        self.seed.is_none() && self.recipe.is_none() && self.once.is_none()
    }

    /// The row it makes of this one.
    pub(crate) fn of(&self, row: &Row) -> Row {
        let (seed, begun) = self.seed.map_or((row.seed, row.begun), |seed| (seed, 0));
        let recipe = Arc::clone(self.recipe.as_ref().unwrap_or(&row.recipe));
        let once = self.once.as_ref().map(|once| (Arc::clone(once.recipe()), once.seed()));
        Row { recipe, seed, begun, once }
    }
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
        let row =
            |slot| Mutex::new(Row { recipe: Arc::clone(&recipe), seed: seed(slot), begun: 0, once: None });
        Arc::new(Self { rows: (0..envs).map(row).collect(), recipe })
    }

    /// An environment's row as it is.
    pub(crate) fn row(&self, slot: usize) -> Row {
        held(&self.rows[slot]).clone()
    }

    /// An environment goes on by this row.
    pub(crate) fn put(&self, slot: usize, row: Row) {
        *held(&self.rows[slot]) = row;
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
        if let Some(once) = row.once.take() {
            return once;
        }
        let number = row.begun;
        row.begun += 1;
        let seed = if number == 0 { row.seed } else { nth_seed(row.seed.get(), 0, number) };
        (Arc::clone(&row.recipe), seed)
    }

    fn only(&self) -> Option<&Arc<Recipe>> {
        Some(&self.0.recipe)
    }
}
