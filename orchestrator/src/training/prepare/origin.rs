//! What an earlier proposal left, for those that go on from it: its scenario again, or an edit of it.

use std::sync::Arc;

use designer::{Brief, vary};
use env_core::bracket::{self, Bracket};
use env_core::draws::Purpose;
use env_core::space::Levels;
use env_core::{Draws, Scenario};

use super::{Place, PrepareError, Prepared, recipe_of};
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
    pub(super) fn again(&self) -> Prepared {
        let Self { scenario, bracket, contested, .. } = self.clone();
        Prepared { scenario, bracket, contested, planted: false }
    }

    /// The first of some edits that is fair and can be solved, as every layout must be before an agent sees it.
    pub(super) fn edited(
        &self,
        place: Place,
        proposal: &Proposal,
        of: u64,
    ) -> Result<Prepared, PrepareError> {
        let mut brief = Brief::new(Arc::new(recipe_of(proposal)?), 1, place.seed(0).get());
        if let Some(level) = proposal.level {
            brief = brief.at_level(&self.levels, level);
        }
        for number in 0..EDITS {
            let mut draws = Draws::new(Purpose::Design, brief.seed, number);
            let Some(varied) = vary(&self.scenario, &brief, &mut draws) else { continue };
            let admission = bracket::admit(&varied.scenario);
            if let (Ok(()), true, Some(bracket)) = (admission.fair, admission.solvable, admission.bracket) {
                let contested = admission.contested;
                return Ok(Prepared { scenario: varied.scenario, bracket, contested, planted: false });
            }
        }
        Err(PrepareError::NoEdit(EDITS, of))
    }
}
