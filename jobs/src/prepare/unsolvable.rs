//! Cache of params under which no scenario is solvable.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use env_core::admission;
use env_core::{Recipe, RecipeId, Scenario, SeedSpace};

use crate::seeds::seed_of;

/// Draws of which none may be solvable for params to count as unsolvable.
const UNSOLVABLE_DRAWS: u64 = 40;
/// Maximum number of recipes in the cache: far more than the levels of all runs.
const MAX_CACHED_RECIPES: usize = 10_000;

/// Returns false once a result is not wanted any more.
pub type IsWanted<'a> = &'a (dyn Fn() -> bool + Sync);

/// Params under which no scenario is solvable. A contested scenario must be solvable, and planting threats makes nothing easier, so
/// no contested one is drawn under them. The answer is a pure function of the recipe, cached because it takes many brackets.
#[derive(Debug, Default)]
pub struct UnsolvableParams(Mutex<HashMap<RecipeId, bool>>);

impl UnsolvableParams {
    /// Returns true if 40 scenarios of the recipe, the same at every call, are all unsolvable. The first solvable one decides. An
    /// answer that was cut short because it is not wanted any more is not cached.
    #[must_use]
    pub fn contains(&self, recipe: &Arc<Recipe>, is_wanted: IsWanted<'_>) -> bool {
        let id = recipe.id();
        // A map behind a poisoned lock is still valid.
        let cache = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(&is_unsolvable) = cache().get(&id) {
            return is_unsolvable;
        }
        let is_unsolvable = !(0..UNSOLVABLE_DRAWS).take_while(|_| is_wanted()).any(|number| {
            let seed = seed_of(SeedSpace::Training, u64::MAX, u64::MAX, number);
            admission::admit(&Scenario::new(Arc::clone(recipe), seed)).solvable
        });
        if is_unsolvable && !is_wanted() {
            return is_unsolvable;
        }
        let mut cached = cache();
        if cached.len() >= MAX_CACHED_RECIPES {
            cached.clear();
        }
        cached.insert(id, is_unsolvable);
        is_unsolvable
    }
}
