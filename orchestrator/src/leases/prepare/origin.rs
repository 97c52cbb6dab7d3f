//! What an earlier proposal left, for those that go on from it: its scenario again, or an edit of it.

use std::sync::Arc;

use designer::{DesignBrief, mutate};
use env_core::admission;
use env_core::bracket::Bracket;
use env_core::keyed_rng::RngPurpose;
use env_core::space::Levels;
use env_core::{KeyedRng, Scenario};

use crate::leases::prepare::{recipe_of, Place, PrepareError, PreparedScenario};
use curriculum::Proposal;

/// Edits tried until one is fair and can be solved.
const EDITS: u64 = 16;

/// The scenario of an earlier proposal.
#[derive(Debug, Clone)]
pub struct Origin {
    /// What was flown.
    pub scenario: Scenario,
    /// Its bracket.
    pub bracket: Bracket,
    /// Whether it is contested.
    pub contested: bool,
    /// The levels of its task, between which edits may go.
    pub levels: Levels,
}

impl Origin {
    /// The same again.
    pub(crate) fn again(&self) -> PreparedScenario {
        let Self { scenario, bracket, contested, .. } = self.clone();
        PreparedScenario { scenario, bracket, contested, planted: false }
    }

    /// The first of some edits that is fair and can be solved, as every layout must be before an agent sees it.
    pub(crate) fn edited(
        &self,
        place: Place,
        proposal: &Proposal,
        of: u64,
    ) -> Result<PreparedScenario, PrepareError> {
        let mut brief = DesignBrief::new(Arc::new(recipe_of(proposal)?), 1, place.seed(0).get());
        if let Some(level) = proposal.level {
            brief = brief.at_level(&self.levels, level);
        }
        for number in 0..EDITS {
            let mut draws = KeyedRng::new(RngPurpose::Design, brief.seed, number);
            let Some(varied) = mutate(&self.scenario, &brief, &mut draws) else { continue };
            let admission = admission::admit(&varied.scenario);
            if let (Ok(()), true, Some(bracket)) = (admission.fair, admission.solvable, admission.bracket) {
                let contested = admission.contested;
                return Ok(PreparedScenario { scenario: varied.scenario, bracket, contested, planted: false });
            }
        }
        Err(PrepareError::NoEdit(EDITS, of))
    }
}
