//! The gate: what a layout must pass before an agent sees it. A refusal is a sentence that goes back to the designer.

use env_core::bracket::{Bracket, MIN_GAP, admit, panel_success};
use env_core::{Scenario, ScenarioError};

/// Why a layout is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// Something is lost before anybody could act.
    #[error("{0}")]
    Unfair(ScenarioError),
    /// The reference planner does not succeed.
    #[error("the planner finds no way to succeed: its best scores {reference:.3} and loses {lost}")]
    Unsolvable {
        /// Its best score.
        reference: f64,
        /// Agents it loses.
        lost: u32,
    },
    /// Acting well hardly matters.
    #[error(
        "acting blindly does nearly as well: {blind} of {panel} blind plans succeed (at most {most} may), and the \
         reference is {gap:.3} above the floor (at least {MIN_GAP} is wanted)"
    )]
    Uncontested {
        /// Blind plans that succeed.
        blind: usize,
        /// Blind plans that may.
        most: usize,
        /// Blind plans there are.
        panel: usize,
        /// reference − floor.
        gap: f64,
    },
}

/// Passes a scenario through the gate as a threat: fair, solvable, contested. The bracket holds the witness.
///
/// # Errors
/// The first refusal, in the order fair, solvable, contested.
pub fn threat(scenario: &Scenario) -> Result<Bracket, Refusal> {
    let admission = admit(scenario);
    let bracket = match (admission.fair, admission.bracket) {
        (Ok(()), Some(bracket)) => bracket,
        (Err(error), _) => return Err(Refusal::Unfair(error)),
        (Ok(()), None) => return Err(Refusal::Unsolvable { reference: 0.0, lost: 0 }),
    };
    if !admission.solvable {
        return Err(Refusal::Unsolvable { reference: bracket.reference.score, lost: bracket.reference.lost });
    }
    if !admission.contested {
        return Err(Refusal::Uncontested {
            blind: panel_success(scenario, &bracket),
            most: bracket.most_blind_successes(),
            panel: bracket.panel.len(),
            gap: bracket.reference.score - bracket.floor,
        });
    }
    Ok(bracket)
}
