//! The sequence of scenarios that each environment of a batch runs.
//!
//! A sequence starts at a seed. Environment k of a batch that was reset with seed s runs the sequence of seed s + k, which
//! is also what a single environment runs that was reset with seed s + k.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use env_core::batch::{ScenarioSource, nth_seed};
use env_core::seed::SeedSpace;
use env_core::{Recipe, Scenario, Seed};

/// Scenario sequence of one environment.
#[derive(Clone)]
pub(crate) struct ScenarioSequence {
    recipe: Arc<Recipe>,
    seed: Seed,
    /// Scenarios begun since the seed was set.
    begun: u64,
    /// Scenario to run once before the sequence continues.
    once: Option<Scenario>,
}

/// Changes that a reset makes to the sequence of one environment.
#[derive(Clone, Default)]
pub(crate) struct ResetRequest {
    /// Restarts the sequence at this seed.
    pub(crate) seed: Option<Seed>,
    /// Replaces the recipe of this and all later scenarios.
    pub(crate) recipe: Option<Arc<Recipe>>,
    /// Scenario to run once before the sequence continues.
    pub(crate) once: Option<Scenario>,
}

impl ResetRequest {
    /// True if the request changes nothing.
    pub(crate) const fn is_empty(&self) -> bool {
        self.seed.is_none() && self.recipe.is_none() && self.once.is_none()
    }

    /// Returns the sequence with the changes of this request.
    pub(crate) fn apply(&self, sequence: &ScenarioSequence) -> ScenarioSequence {
        let (seed, begun) = self.seed.map_or((sequence.seed, sequence.begun), |seed| (seed, 0));
        let recipe = Arc::clone(self.recipe.as_ref().unwrap_or(&sequence.recipe));
        ScenarioSequence { recipe, seed, begun, once: self.once.clone() }
    }
}

/// Scenario sequences of all environments of a batch.
pub(crate) struct ScenarioSequences {
    slots: Vec<Mutex<ScenarioSequence>>,
    recipe: Arc<Recipe>,
}

impl ScenarioSequences {
    /// Creates the sequences of `envs` environments; environment k starts at the user seed `first_seed + k`.
    pub(crate) fn new(envs: usize, recipe: Arc<Recipe>, first_seed: u64) -> Arc<Self> {
        let slot = |slot: usize| {
            let seed = Seed::in_space(SeedSpace::User, first_seed.wrapping_add(slot as u64));
            Mutex::new(ScenarioSequence { recipe: Arc::clone(&recipe), seed, begun: 0, once: None })
        };
        Arc::new(Self { slots: (0..envs).map(slot).collect(), recipe })
    }

    /// Returns a copy of an environment's sequence.
    pub(crate) fn get(&self, slot: usize) -> ScenarioSequence {
        lock(&self.slots[slot]).clone()
    }

    /// Replaces an environment's sequence.
    pub(crate) fn set(&self, slot: usize, sequence: ScenarioSequence) {
        *lock(&self.slots[slot]) = sequence;
    }

    /// Rewinds all sequences to their seeds: making a batch reads the first scenario before the first reset.
    pub(crate) fn rewind(&self) {
        self.slots.iter().for_each(|slot| lock(slot).begun = 0);
    }
}

/// Feeds a batch with its scenario sequences.
pub(crate) struct SequenceFeed(pub(crate) Arc<ScenarioSequences>);

impl ScenarioSource for SequenceFeed {
    fn scenario(&self, slot: usize, _: u64) -> Scenario {
        let mut sequence = lock(&self.0.slots[slot]);
        if let Some(once) = sequence.once.take() {
            return once;
        }
        let number = sequence.begun;
        sequence.begun += 1;
        let seed = if number == 0 { sequence.seed } else { nth_seed(sequence.seed.get(), 0, number) };
        Scenario::new(Arc::clone(&sequence.recipe), seed)
    }

    fn single_recipe(&self) -> Option<&Arc<Recipe>> {
        Some(&self.0.recipe)
    }
}

fn lock(slot: &Mutex<ScenarioSequence>) -> MutexGuard<'_, ScenarioSequence> {
    // No holder can panic; even if one did, the sequence would be valid.
    slot.lock().unwrap_or_else(PoisonError::into_inner)
}
