//! Scenarios that derive from the scenario of an earlier proposal: a replay of it, or an edit.

use std::sync::Arc;

use designer::{DesignBrief, mutate};
use env_core::admission;
use env_core::bracket::Bracket;
use env_core::keyed_rng::RngPurpose;
use env_core::space::Levels;
use env_core::{KeyedRng, Scenario};

use crate::prepare::{PrepareError, PreparedScenario, SeedSource, recipe_of};
use curriculum::Proposal;

/// Maximum number of edits that are tried until one is fair and solvable.
const MAX_EDITS: u64 = 16;

/// The scenario of an earlier proposal.
#[derive(Debug, Clone)]
pub struct ParentScenario {
    /// The scenario, with its seed.
    pub scenario: Scenario,
    /// Bracket of the scenario.
    pub bracket: Bracket,
    /// True if the scenario is contested.
    pub is_contested: bool,
    /// Levels of the task; edits stay between them.
    pub levels: Levels,
}

impl ParentScenario {
    /// Returns the same scenario.
    pub(crate) fn replay(&self) -> PreparedScenario {
        let Self { scenario, bracket, is_contested, .. } = self.clone();
        PreparedScenario { scenario, bracket, is_contested, is_planted: false }
    }

    /// Returns the first edit that is fair and solvable, as every layout must be before an agent sees it.
    ///
    /// # Errors
    /// Returns [`PrepareError::NoEdit`] if none of 16 edits is, and [`PrepareError::Scenario`] if the proposal has no recipe.
    pub(crate) fn edit(
        &self,
        seeds: SeedSource,
        proposal: &Proposal,
        parent: u64,
    ) -> Result<PreparedScenario, PrepareError> {
        let mut brief = DesignBrief::new(Arc::new(recipe_of(proposal)?), 1, seeds.seed(0).get());
        if let Some(level) = proposal.level {
            brief = brief.at_level(&self.levels, level);
        }
        for number in 0..MAX_EDITS {
            let mut rng = KeyedRng::new(RngPurpose::Design, brief.seed, number);
            let Some(edited) = mutate(&self.scenario, &brief, &mut rng) else { continue };
            let admission = admission::admit(&edited.scenario);
            if let (Ok(()), true, Some(bracket)) = (admission.fair, admission.solvable, admission.bracket) {
                return Ok(PreparedScenario {
                    scenario: edited.scenario,
                    bracket,
                    is_contested: admission.contested,
                    is_planted: false,
                });
            }
        }
        Err(PrepareError::NoEdit { tried: MAX_EDITS, parent })
    }
}
