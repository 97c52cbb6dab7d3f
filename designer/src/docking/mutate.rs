//! Mutates scenarios: changes of the deputies, and of the params that act on existing ones.

use std::collections::BTreeMap;

use env_core::docking::constants::STATE_DIM;
use env_core::docking::relative_motion::{RelativeState, distance, speed_limit};
use env_core::docking::setup::DockingSetup;
use env_core::episode_rng::SeededRng;
use env_core::task::LayoutMode;
use env_core::{KeyedRng, Layout, Recipe, Scenario};

use super::vocabulary::effective_choices;
use crate::brief::DesignBrief;
use crate::mutation::{Mutation, adjacent_value, pick_choice};

/// Maximum number of attempts to mutate a scenario.
const MAX_ATTEMPTS: u32 = 12;
/// Maximum change of a position along each axis, as a share of the distance to the chief.
const POSITION_CHANGE: f64 = 0.15;
/// Maximum change of a velocity along each axis, as a share of the speed limit at its position.
const VELOCITY_CHANGE: f64 = 0.15;

/// Edit of a recipe or of the initial states of the deputies; `None` if it does not apply.
type ScenarioEdit = fn(&mut Recipe, &mut [RelativeState], &DesignBrief, &mut KeyedRng) -> Option<()>;

/// Edits of a scenario. The names are stored with it.
const EDITS: [(&str, ScenarioEdit); 3] =
    [("a deputy's place", move_deputy), ("a deputy's velocity", change_velocity), ("a param", change_param)];

/// Returns a scenario after one or two edits; `None` if no attempt succeeds.
pub(crate) fn mutate(parent: &Scenario, brief: &DesignBrief, rng: &mut KeyedRng) -> Option<Mutation> {
    let setup = DockingSetup::read(parent.recipe()).ok()?;
    let start = setup.sample_starts(&mut SeededRng::new(parent.seed())).ok()?;
    let recipe_without_layout = parent.recipe().as_ref().clone().with_layout(None).ok()?;
    for _ in 0..MAX_ATTEMPTS {
        let mut recipe = recipe_without_layout.clone();
        let mut states = start.states[..start.deputies].to_vec();
        let mut changes = Vec::new();
        for _ in 0..rng.range_inclusive(1, 2) {
            let (name, edit) = EDITS[rng.below(EDITS.len() as u32) as usize];
            if edit(&mut recipe, &mut states, brief, rng).is_some() {
                changes.push(name);
            }
        }
        let rows = states.iter().map(|state| state.to_vec()).collect();
        let bodies = BTreeMap::from([("deputies".to_owned(), rows)]);
        let layout = Layout { mode: LayoutMode::Replace, bodies, provenance: None };
        if let (false, Ok(recipe)) = (changes.is_empty(), recipe.with_layout(Some(layout))) {
            return Some(Mutation { scenario: Scenario::new(recipe, parent.seed()), changes });
        }
    }
    None
}

/// Returns the state of a random deputy.
fn pick<'a>(states: &'a mut [RelativeState], rng: &mut KeyedRng) -> Option<&'a mut RelativeState> {
    let count = u32::try_from(states.len()).ok().filter(|count| *count > 0)?;
    states.get_mut(rng.below(count) as usize)
}

/// Changes some components of a state by up to `max_change` either way.
fn jitter(
    state: &mut RelativeState,
    components: std::ops::Range<usize>,
    max_change: f64,
    rng: &mut KeyedRng,
) {
    for value in &mut state[components] {
        *value += max_change * (2.0 * rng.uniform() - 1.0);
    }
}

fn move_deputy(
    _: &mut Recipe,
    states: &mut [RelativeState],
    _: &DesignBrief,
    rng: &mut KeyedRng,
) -> Option<()> {
    let state = pick(states, rng)?;
    jitter(state, 0..STATE_DIM / 2, POSITION_CHANGE * distance(state), rng);
    Some(())
}

fn change_velocity(
    _: &mut Recipe,
    states: &mut [RelativeState],
    _: &DesignBrief,
    rng: &mut KeyedRng,
) -> Option<()> {
    let state = pick(states, rng)?;
    jitter(state, STATE_DIM / 2..STATE_DIM, VELOCITY_CHANGE * speed_limit(distance(state)), rng);
    Some(())
}

/// Changes a param to an adjacent value. The states already decide the number of deputies and their initial distances.
fn change_param(
    recipe: &mut Recipe,
    _: &mut [RelativeState],
    brief: &DesignBrief,
    rng: &mut KeyedRng,
) -> Option<()> {
    let choices = effective_choices(brief);
    let choice = pick_choice(&choices, rng)?;
    let value = adjacent_value(recipe, choice, rng)?;
    *recipe = recipe.clone().with_param(&choice.param, value).ok()?;
    Some(())
}
