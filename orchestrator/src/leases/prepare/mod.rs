//! From a proposal to a scenario with its bracket: drawn until it is what was asked for, planted where that does not
//! come by itself. A pure function of (run seed, seq, proposal), so that it does not matter who computes it, when,
//! or how often.

mod choice;
mod origin;
use env_core::admission;
use env_core::bracket::Bracket;
use env_core::{Recipe, RecipeId, Scenario, ScenarioError, Seed, SeedSpace};
use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, Mutex, PoisonError};

use sqlx::SqliteConnection;

use self::choice::Choice;
pub use self::origin::Origin;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;
use crate::leases::refill;
use crate::store::proposals::{PreparedProposal, ProposalKey};
use crate::store::{self, StoreError};
use curriculum::{Proposal, ScenarioSource};

/// Draws at a contested scenario before one is planted.
const CONTESTED_DRAWS: u64 = 200;
/// Scenarios tried for planting.
const PLANT_DRAWS: u64 = 4;
/// Draws by which params are found to be ones that nobody could succeed under.
const HOPELESS_DRAWS: u64 = 40;
/// Draws at a fair scenario.
const FAIR_DRAWS: u64 = 64;

/// Params under which nobody could succeed: a contested scenario must be solvable, and planting threats makes nothing
/// easier, so that none need be looked for. A pure function of the recipe, remembered because it takes many brackets.
#[derive(Debug, Default)]
pub struct UnsolvableParams(Mutex<HashMap<RecipeId, bool>>);

/// Recipes remembered: far more than the levels of all runs.
const MOST_REMEMBERED: usize = 10_000;

impl UnsolvableParams {
    /// Whether 40 scenarios of the recipe, the same for everybody, are all unsolvable. The first that is not decides. Where nobody
    /// waits any more it is left open.
    #[must_use]
    pub fn are(&self, recipe: &Arc<Recipe>, waits: Waits<'_>) -> bool {
        let id = recipe.id();
        // A map behind a poisoned lock is still a map.
        let known = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(&told) = known().get(&id) {
            return told;
        }
        let told = !(0..HOPELESS_DRAWS).take_while(|_| waits()).any(|number| {
            let seed = seed_of(SeedSpace::Training, u64::MAX, u64::MAX, number);
            admission::admit(&Scenario::new(Arc::clone(recipe), seed)).solvable
        });
        if told && !waits() {
            return told;
        }
        let mut remembered = known();
        if remembered.len() >= MOST_REMEMBERED {
            remembered.clear();
        }
        remembered.insert(id, told);
        told
    }
}

/// Whether somebody waits for what is looked for; asked before each draw.
pub type Waits<'a> = &'a dyn Fn() -> bool;

/// A scenario ready to be leased.
#[derive(Debug, Clone)]
pub struct PreparedScenario {
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

/// The recipe that a proposal asks for.
///
/// # Errors
/// Params or options that its task does not have.
pub fn recipe_of(proposal: &Proposal) -> Result<Recipe, ScenarioError> {
    let task = env_core::task(&proposal.task).ok_or_else(|| ScenarioError::UnknownChoice {
        field: "task".to_owned(),
        value: proposal.task.clone(),
        choices: String::new(),
    })?;
    let params = proposal.params.iter().map(|(name, value)| (name.as_str(), *value));
    let options = proposal.physics.iter().map(|(name, choice)| (name.as_str(), choice.as_str()));
    Recipe::with_params(task, params)?.with_options(options)
}

/// Where a proposal's draws come from.
#[derive(Debug, Clone, Copy)]
pub struct Place {
    /// Whose seeds.
    pub space: SeedSpace,
    /// The run's seed.
    pub run_seed: u64,
    /// The proposal's seq.
    pub seq: u64,
}

impl Place {
    /// The seed of a draw.
    fn seed(self, draw: u64) -> Seed {
        seed_of(self.space, self.run_seed, self.seq, draw)
    }
}

/// Why a proposal has no scenario.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// Its params cannot be, or no fair start exists under them.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// It goes on from a scenario that is not there.
    #[error("the scenario of proposal {0}, which it goes on from, is not kept any more")]
    Gone(u64),
    /// Nobody waits for it any more.
    #[error("nobody waits for it any more")]
    NotWanted,
    /// None of the edits that were tried is fair and can be solved.
    #[error("none of {0} edits of the scenario of proposal {1} is fair and can be solved")]
    NoEdit(u64, u64),
}

/// Prepares a proposal. One that goes on from an earlier one needs what that left.
///
/// # Errors
/// Params for which no fair start exists, nothing to go on from, or nobody who waits.
pub fn prepare(
    place: Place,
    proposal: &Proposal,
    origin: Option<&Origin>,
    (hopeless, waits): (&UnsolvableParams, Waits<'_>),
) -> Result<PreparedScenario, PrepareError> {
    match proposal.source {
        ScenarioSource::Fresh => draw(place, proposal, (hopeless, waits), None),
        ScenarioSource::Chosen { among, base, panel } => {
            draw(place, proposal, (hopeless, waits), Some(Choice::new(among, base, panel)))
        }
        ScenarioSource::Replay { of } => origin.map(Origin::again).ok_or(PrepareError::Gone(of)),
        ScenarioSource::Edited { of } => origin.ok_or(PrepareError::Gone(of))?.edited(place, proposal, of),
    }
}

/// Draws until a scenario is what was asked for, or as many are there as are to be chosen from; plants a threat where none comes.
fn draw(
    place: Place,
    proposal: &Proposal,
    (hopeless, waits): (&UnsolvableParams, Waits<'_>),
    mut choice: Option<Choice>,
) -> Result<PreparedScenario, PrepareError> {
    let recipe = Arc::new(recipe_of(proposal)?);
    let task = recipe.task();
    let draw = |number| Scenario::new(Arc::clone(&recipe), place.seed(number));
    let wants_contested = proposal.contested && !hopeless.are(&recipe, waits);
    let draws = if wants_contested { CONTESTED_DRAWS } else { FAIR_DRAWS };
    let mut last = None;
    let mut unfair = None;
    for number in 0..draws {
        if !waits() {
            return Err(PrepareError::NotWanted);
        }
        let scenario = draw(number);
        let admission = admission::admit(&scenario);
        match (admission.fair, admission.bracket) {
            (Ok(()), Some(bracket)) => {
                let contested = admission.contested;
                let prepared = PreparedScenario { scenario, bracket, contested, planted: false };
                if !contested && wants_contested {
                    last = Some(prepared);
                    continue;
                }
                match &mut choice {
                    None => return Ok(prepared),
                    Some(choice) => {
                        if choice.take(prepared) {
                            break;
                        }
                    }
                }
            }
            (fair, _) => unfair = fair.err(),
        }
    }
    if let Some(best) = choice.and_then(Choice::best) {
        return Ok(best);
    }
    for number in 0..PLANT_DRAWS {
        let bare = draw(draws + number);
        if let Some((scenario, bracket)) = task.make_contested(&bare) {
            return Ok(PreparedScenario { scenario, bracket, contested: true, planted: true });
        }
    }
    // Nothing contested is to be had (at params where nothing can go wrong, or nothing can be saved): as it comes.
    last.ok_or_else(|| {
        let none = || ScenarioError::Unfair {
            field: "params".to_owned(),
            reason: "no fair start was drawn".to_owned(),
        };
        unfair.unwrap_or_else(none).into()
    })
}

/// Stores scenarios with their brackets, once each.
pub(crate) async fn store_all(
    conn: &mut SqliteConnection,
    all: impl Iterator<Item = &PreparedScenario>,
) -> Result<(), StoreError> {
    let all: Vec<_> =
        all.map(|prepared| (&prepared.scenario, prepared.scenario.id(), &prepared.bracket)).collect();
    let scenarios: Vec<_> = all.iter().map(|(scenario, ..)| *scenario).collect();
    store::scenarios::insert(conn, &scenarios).await?;
    let brackets: Vec<_> = all.iter().map(|(_, id, bracket)| (id.0.as_slice(), *bracket)).collect();
    store::brackets::insert(conn, &brackets).await
}

/// Stores what was prepared.
#[derive(Debug)]
pub struct StorePrepared {
    /// (run, seq, what).
    pub prepared: Vec<(String, i64, PreparedScenario)>,
    /// (run, seq) of proposals that cannot be prepared.
    pub hopeless: Vec<(String, i64)>,
}

impl Change for StorePrepared {
    type Output = ();
    const IS_BULK: bool = true;

    async fn apply(mut self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        // What was dropped meanwhile is wanted no more, and nobody would ever delete it.
        let key = |run: &str, seq| ProposalKey { run: run.to_owned(), seq };
        let keys: Vec<_> = self.prepared.iter().map(|(run, seq, _)| key(run, *seq)).collect();
        let wanted = store::proposals::unprepared_among(&mut tx.conn, &keys).await?;
        self.prepared.retain(|(run, seq, _)| wanted.contains(&key(run, *seq)));
        store_all(&mut tx.conn, self.prepared.iter().map(|(.., prepared)| prepared)).await?;
        let rows = self.prepared.iter().map(|(run, seq, prepared)| {
            let (scenario, is_contested) = (prepared.scenario.id().0, prepared.contested);
            PreparedProposal { run, seq: *seq, scenario, is_contested, is_planted: prepared.planted }
        });
        store::proposals::set_prepared(&mut tx.conn, &rows.collect::<Vec<_>>()).await?;
        for (run, seq) in &self.hopeless {
            store::proposals::drop_all(&mut tx.conn, run, &[*seq]).await?;
        }
        // Whoever was promised a scenario has it now.
        let runs: BTreeSet<&String> = self.prepared.iter().map(|(run, ..)| run).collect();
        for run in runs {
            refill::grant_refills(&mut tx.run(run).await?).await?;
        }
        Ok(())
    }
}
