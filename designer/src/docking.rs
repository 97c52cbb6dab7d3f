//! Edits of docking's scenarios. Nobody designs layouts for docking yet: there is no language for them.

use std::collections::BTreeMap;

use env_core::chance::Seeded;
use env_core::docking::constants::STATE;
use env_core::docking::relative::{State, distance, speed_limit};
use env_core::docking::setup::Setup;
use env_core::scenario::LayoutMode;
use env_core::{Draws, Layout, Recipe, Scenario};

use crate::brief::Brief;
use crate::vary::{Varied, beside};

/// Tries at a change that can be.
const TRIES: u32 = 12;
/// How far a deputy's start is moved along each axis, as a share of its distance from the chief.
const MOVED: f64 = 0.15;
/// How far its velocity is changed along each axis, as a share of the speed limit there.
const JITTER: f64 = 0.15;

type Change = fn(&mut Recipe, &mut Vec<State>, &Brief, &mut Draws) -> Option<()>;

const CHANGES: [(&str, Change); 3] =
    [("a deputy's place", place), ("a deputy's velocity", velocity), ("a param", param)];

/// A scenario with one or two things changed.
pub(crate) fn vary(parent: &Scenario, brief: &Brief, draws: &mut Draws) -> Option<Varied> {
    let setup = Setup::read(parent.recipe()).ok()?;
    let start = setup.start(&mut Seeded::new(parent.seed())).ok()?;
    let bare = parent.recipe().as_ref().clone().with_layout(None).ok()?;
    for _ in 0..TRIES {
        let (mut recipe, mut states) = (bare.clone(), start.states[..start.deputies].to_vec());
        let mut changes = Vec::new();
        for _ in 0..draws.between(1, 2) {
            let (name, change) = CHANGES[draws.below(CHANGES.len() as u32) as usize];
            if change(&mut recipe, &mut states, brief, draws).is_some() {
                changes.push(name);
            }
        }
        let rows = states.iter().map(|state| state.to_vec()).collect();
        let bodies = BTreeMap::from([("deputies".to_owned(), rows)]);
        let layout = Layout { mode: LayoutMode::Replace, bodies, provenance: None };
        if let (false, Ok(recipe)) = (changes.is_empty(), recipe.with_layout(Some(layout))) {
            return Some(Varied { scenario: Scenario::new(recipe, parent.seed()), changes });
        }
    }
    None
}

fn pick<'a>(states: &'a mut [State], draws: &mut Draws) -> Option<&'a mut State> {
    let count = u32::try_from(states.len()).ok().filter(|count| *count > 0)?;
    states.get_mut(draws.below(count) as usize)
}

/// Moves what is at `axes` of a state by up to `by` either way.
fn jitter(state: &mut State, axes: std::ops::Range<usize>, by: f64, draws: &mut Draws) {
    for value in &mut state[axes] {
        *value += by * (2.0 * draws.uniform() - 1.0);
    }
}

fn place(_: &mut Recipe, states: &mut Vec<State>, _: &Brief, draws: &mut Draws) -> Option<()> {
    let state = pick(states, draws)?;
    jitter(state, 0..STATE / 2, MOVED * distance(state), draws);
    Some(())
}

fn velocity(_: &mut Recipe, states: &mut Vec<State>, _: &Brief, draws: &mut Draws) -> Option<()> {
    let state = pick(states, draws)?;
    jitter(state, STATE / 2..STATE, JITTER * speed_limit(distance(state)), draws);
    Some(())
}

/// A param beside what it is. How many deputies there are, and where they start, is said by the states.
fn param(recipe: &mut Recipe, _: &mut Vec<State>, brief: &Brief, draws: &mut Draws) -> Option<()> {
    let free: Vec<_> = brief
        .limits
        .iter()
        .filter(|limit| matches!(limit.param.as_str(), "time_limit_s" | "thrust_bound"))
        .collect();
    let count = u32::try_from(free.len()).ok().filter(|count| *count > 0)?;
    let limit = free[draws.below(count) as usize];
    let value = beside(recipe, limit, draws)?;
    *recipe = recipe.clone().with_param(&limit.param, value).ok()?;
    Some(())
}
