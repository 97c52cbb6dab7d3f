//! From a proposal to a scenario with its bracket: drawn until it is what was asked for, planted where that does not
//! come by itself. A pure function of (run seed, seq, proposal), so that it does not matter who computes it, when,
//! or how often.

use env_core::bracket::{self, Bracket};
use env_core::{Recipe, Scenario, ScenarioError, Seed, SeedSpace};
use std::sync::Arc;

use super::{Change, TrainingError, Work};
use crate::curriculum::Proposal;
use crate::store;

/// Draws at a contested scenario before one is planted.
const CONTESTED_DRAWS: u64 = 200;
/// Scenarios tried for planting.
const PLANT_DRAWS: u64 = 4;
/// Draws after which params that nobody could succeed under are given up: a contested scenario must be solvable, and
/// planting threats makes nothing easier.
const HOPELESS_DRAWS: u64 = 40;
/// Draws at a fair scenario.
const FAIR_DRAWS: u64 = 64;

/// A scenario ready to be leased.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The scenario.
    pub scenario: Scenario,
    /// Its bracket.
    pub bracket: Bracket,
    /// Whether it is contested.
    pub contested: bool,
    /// Whether a threat was planted to make it so.
    pub planted: bool,
}

/// The seed of a draw: of a space, from (run seed, seq, number).
#[must_use]
pub fn seed_of(space: SeedSpace, run_seed: u64, seq: u64, draw: u64) -> Seed {
    let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 scenario seeds");
    for part in [run_seed, seq, draw] {
        hasher.update(&part.to_le_bytes());
    }
    let mut bits = [0; 8];
    hasher.finalize_xof().fill(&mut bits);
    Seed::in_space(space, u64::from_le_bytes(bits))
}

/// Prepares a proposal.
///
/// # Errors
/// Params for which no fair start exists.
pub fn prepare(
    space: SeedSpace,
    run_seed: u64,
    seq: u64,
    proposal: &Proposal,
) -> Result<Prepared, ScenarioError> {
    let task = env_core::task(&proposal.task).ok_or_else(|| ScenarioError::UnknownChoice {
        field: "task".to_owned(),
        value: proposal.task.clone(),
        choices: String::new(),
    })?;
    let params = proposal.params.iter().map(|(name, value)| (name.as_str(), *value));
    let recipe = Arc::new(Recipe::with_params(task, params)?);
    let draw = |number| Scenario::new(Arc::clone(&recipe), seed_of(space, run_seed, seq, number));
    let draws = if proposal.contested { CONTESTED_DRAWS } else { FAIR_DRAWS };
    let mut last = None;
    let mut unfair = None;
    let mut solvable = false;
    for number in 0..draws {
        if number == HOPELESS_DRAWS
            && !solvable
            && let Some(last) = last
        {
            return Ok(last);
        }
        let scenario = draw(number);
        let admission = bracket::admit(&scenario);
        match (admission.fair, admission.bracket) {
            (Ok(()), Some(bracket)) => {
                let contested = admission.contested;
                solvable |= admission.solvable;
                let prepared = Prepared { scenario, bracket, contested, planted: false };
                if contested || !proposal.contested {
                    return Ok(prepared);
                }
                last = Some(prepared);
            }
            (fair, _) => unfair = fair.err(),
        }
    }
    for number in 0..PLANT_DRAWS {
        let bare = draw(draws + number);
        if let Some((scenario, bracket)) = task.plant_contested(&bare) {
            return Ok(Prepared { scenario, bracket, contested: true, planted: true });
        }
    }
    // Nothing contested is to be had (at params where nothing can go wrong, or nothing can be saved): as it comes.
    last.ok_or_else(|| {
        unfair.unwrap_or_else(|| ScenarioError::Unfair {
            field: "params".to_owned(),
            reason: "no fair start was drawn".to_owned(),
        })
    })
}

/// Stores what was prepared.
#[derive(Debug)]
pub struct StorePrepared {
    /// (run, seq, what).
    pub prepared: Vec<(String, i64, Prepared)>,
    /// (run, seq) of proposals that cannot be prepared.
    pub hopeless: Vec<(String, i64)>,
}

impl Change for StorePrepared {
    type Answer = ();

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        for (run, seq, prepared) in &self.prepared {
            let id = prepared.scenario.id().0.to_vec();
            store::scenarios::insert(&mut work.conn, &prepared.scenario).await?;
            store::brackets::insert(&mut work.conn, &id, &prepared.bracket).await?;
            store::proposals::prepared(&mut work.conn, run, *seq, &id, prepared.contested, prepared.planted)
                .await?;
        }
        for (run, seq) in &self.hopeless {
            store::proposals::discard(&mut work.conn, run, *seq).await?;
        }
        Ok(())
    }
}
