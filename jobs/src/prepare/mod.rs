//! Turns proposals into scenarios with brackets, ready to be leased.
//!
//! [`prepare`] draws scenarios until one is as proposed, and plants a threat if no contested one comes up. It is a pure function of
//! (run seed, sequence number, proposal): the result does not depend on the worker, the time or the number of tries.
//! `parent_scenario` has proposals that derive from an earlier scenario, `scenario_choice` those that choose among several,
//! [`unsolvable`] the cache of params under which no scenario is solvable, and [`job`] the payload of a job.

pub mod job;
mod parent_scenario;
mod scenario_choice;
pub mod unsolvable;

use std::sync::Arc;

use env_core::admission;
use env_core::bracket::Bracket;
use env_core::{Recipe, Scenario, ScenarioError, Seed, SeedSpace};

pub use self::parent_scenario::ParentScenario;
use self::scenario_choice::ScenarioChoice;
use self::unsolvable::{IsWanted, UnsolvableParams};
use crate::seeds::seed_of;
use curriculum::{Proposal, ScenarioSource};

/// Maximum number of draws for a contested scenario, before a threat is planted.
const CONTESTED_DRAWS: u64 = 200;
/// Maximum number of scenarios in which a threat is planted.
const PLANT_DRAWS: u64 = 4;
/// Maximum number of draws for a fair scenario.
const FAIR_DRAWS: u64 = 64;

/// A scenario that is ready to be leased.
#[derive(Debug, Clone, PartialEq)]
pub struct PreparedScenario {
    /// The scenario, with its seed.
    pub scenario: Scenario,
    /// Bracket of the scenario.
    pub bracket: Bracket,
    /// True if the scenario is contested.
    pub is_contested: bool,
    /// True if a threat was planted to make it contested.
    pub is_planted: bool,
}

/// Returns the recipe of a proposal.
///
/// # Errors
/// Returns [`ScenarioError`] if the task is unknown, or has not the proposed params or options.
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

/// Source of the seeds that are drawn for a proposal.
#[derive(Debug, Clone, Copy)]
pub struct SeedSource {
    /// Space of the seeds.
    pub space: SeedSpace,
    /// Seed of the run.
    pub run_seed: u64,
    /// Sequence number of the proposal.
    pub seq: u64,
}

impl SeedSource {
    /// Returns the seed of a draw.
    fn seed(self, draw: u64) -> Seed {
        seed_of(self.space, self.run_seed, self.seq, draw)
    }
}

/// Reason why a proposal has no scenario.
#[derive(Debug, thiserror::Error)]
pub enum PrepareError {
    /// The params are invalid, or no fair start exists under them.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The scenario that the proposal derives from is not stored any more.
    #[error("the scenario of proposal {0}, from which it derives, was deleted")]
    Gone(u64),
    /// The worker that asked for the scenario has stopped.
    #[error("the request for the scenario was cancelled")]
    Abandoned,
    /// None of the edits is fair and solvable.
    #[error("none of {tried} edits of the scenario of proposal {parent} is fair and solvable")]
    NoEdit {
        /// Number of edits that were tried.
        tried: u64,
        /// Sequence number of the proposal whose scenario was edited.
        parent: u64,
    },
}

/// Shared state of the draws for proposals.
#[derive(Clone, Copy)]
pub struct DrawContext<'a> {
    /// Params under which no scenario is solvable.
    pub unsolvable: &'a UnsolvableParams,
    /// Returns false once the result is not wanted any more; called before each draw.
    pub is_wanted: IsWanted<'a>,
}

/// Prepares a proposal. `parent` is the scenario that it derives from, if it derives from one.
///
/// # Errors
/// Returns [`PrepareError`] if no fair start exists, if the parent is missing, or if the result is not wanted any more.
pub fn prepare(
    seeds: SeedSource,
    proposal: &Proposal,
    parent: Option<&ParentScenario>,
    context: DrawContext<'_>,
) -> Result<PreparedScenario, PrepareError> {
    match proposal.source {
        ScenarioSource::Fresh => draw(seeds, proposal, context, None),
        ScenarioSource::Chosen { among, base, panel } => {
            draw(seeds, proposal, context, Some(ScenarioChoice::new(among, base, panel)))
        }
        ScenarioSource::Replay { of } => parent.map(ParentScenario::replay).ok_or(PrepareError::Gone(of)),
        ScenarioSource::Edited { of } => parent.ok_or(PrepareError::Gone(of))?.edit(seeds, proposal, of),
    }
}

/// Draws scenarios until one is as proposed, or until the choice is complete. Plants a threat if no contested scenario comes up.
fn draw(
    seeds: SeedSource,
    proposal: &Proposal,
    context: DrawContext<'_>,
    mut choice: Option<ScenarioChoice>,
) -> Result<PreparedScenario, PrepareError> {
    let recipe = Arc::new(recipe_of(proposal)?);
    let scenario_of = |number| Scenario::new(Arc::clone(&recipe), seeds.seed(number));
    let wants_contested = proposal.contested && !context.unsolvable.contains(&recipe, context.is_wanted);
    let draws = if wants_contested { CONTESTED_DRAWS } else { FAIR_DRAWS };
    let mut uncontested = None;
    let mut unfair = None;
    for number in 0..draws {
        if !(context.is_wanted)() {
            return Err(PrepareError::Abandoned);
        }
        let scenario = scenario_of(number);
        let admission = admission::admit(&scenario);
        let (Ok(()), Some(bracket)) = (&admission.fair, admission.bracket) else {
            unfair = admission.fair.err();
            continue;
        };
        let is_contested = admission.contested;
        let prepared = PreparedScenario { scenario, bracket, is_contested, is_planted: false };
        if !is_contested && wants_contested {
            uncontested = Some(prepared);
            continue;
        }
        match &mut choice {
            None => return Ok(prepared),
            Some(choice) => {
                if choice.add(prepared) {
                    break;
                }
            }
        }
    }
    if let Some(best) = choice.and_then(ScenarioChoice::best) {
        return Ok(best);
    }
    for number in draws..draws + PLANT_DRAWS {
        if let Some((scenario, bracket)) = recipe.task().make_contested(&scenario_of(number)) {
            return Ok(PreparedScenario { scenario, bracket, is_contested: true, is_planted: true });
        }
    }
    // No contested scenario exists (under params where nothing can go wrong, or nothing can be saved): take an uncontested one.
    uncontested.ok_or_else(|| unfair.unwrap_or_else(no_fair_start).into())
}

fn no_fair_start() -> ScenarioError {
    ScenarioError::Unfair { field: "params".to_owned(), reason: "no draw of the start was fair".to_owned() }
}
