//! Scenarios: a recipe and a seed, which with the actions decide every bit of an episode.

use std::fmt;
use std::sync::Arc;

use serde_json::{Value, json};

use super::TaskSpec;
use super::recipe::Recipe;
use crate::canonical::Canonical;
use crate::seed::Seed;

/// A recipe and a seed: `(scenario, actions)` decides every bit of the episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    recipe: Arc<Recipe>,
    seed: Seed,
}

/// Identity of a scenario: blake3 of its canonical form.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ScenarioId(pub [u8; 32]);

impl fmt::Display for ScenarioId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl Scenario {
    /// A recipe with a seed.
    #[must_use]
    pub fn new(recipe: impl Into<Arc<Recipe>>, seed: Seed) -> Self {
        Self { recipe: recipe.into(), seed }
    }

    /// Recipe of the scenario.
    #[must_use]
    pub fn recipe(&self) -> &Arc<Recipe> {
        &self.recipe
    }

    /// Seed of the scenario.
    #[must_use]
    pub const fn seed(&self) -> Seed {
        self.seed
    }

    /// Task of the recipe.
    #[must_use]
    pub fn task(&self) -> &'static dyn TaskSpec {
        self.recipe.task
    }

    /// The canonical bytes: the seed, then those of the recipe.
    #[must_use]
    pub fn canonical(&self) -> Vec<u8> {
        let mut out = Canonical::new("sparring-scenario/1");
        out.whole(self.seed.get());
        let mut bytes = out.finish();
        bytes.extend_from_slice(&self.recipe.canonical());
        bytes
    }

    /// The id: blake3 of the canonical bytes.
    #[must_use]
    pub fn id(&self) -> ScenarioId {
        ScenarioId(*blake3::hash(&self.canonical()).as_bytes())
    }

    /// The scenario as JSON, with every param and option written out.
    #[must_use]
    pub fn to_json(&self) -> Value {
        let mut value = self.recipe.to_json();
        value["seed"] = json!(self.seed.get());
        value
    }
}
