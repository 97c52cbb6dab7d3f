//! What the levels are worth: policies on contested scenarios, task by task; the tables of `docs/kessler.md` and
//! `docs/docking.md`. Asked for by name: it measures success, not speed.

use std::sync::Arc;

use anyhow::Context;
use env_core::bracket::{admit, success};
use env_core::rollout::fly;
use env_core::{Recipe, Scenario, Seed, SuccessRule, TaskSpec};
use rayon::prelude::*;

use crate::Row;

/// Contested scenarios a cell.
const CELL: usize = 200;
/// Scenarios looked at for them.
const MOST: u64 = 2000;
/// The first seed.
const FIRST: u64 = 7_000_000;
const POLICIES: [&str; 4] = ["heuristic", "frozen", "blind", "hold"];

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for task in env_core::tasks() {
        for level in 0..task.levels().len() {
            let (drawn, wins) = cell(task, level)?;
            let share = |wins: usize| wins as f64 / CELL.min(drawn.1).max(1) as f64;
            let told: Vec<String> =
                POLICIES.iter().zip(wins).map(|(name, wins)| format!("{name} {:.2}", share(wins))).collect();
            rows.push(Row {
                what: format!(
                    "{} L{level}, contested {:.2} of {} drawn",
                    task.id(),
                    drawn.1 as f64 / drawn.0 as f64,
                    drawn.0
                ),
                measured: told.join(", "),
                goal: String::new(),
                ratio: None,
            });
        }
    }
    Ok(rows)
}

/// (drawn, contested), and how many of the contested each policy wins.
fn cell(task: &'static dyn TaskSpec, level: usize) -> anyhow::Result<((usize, usize), [usize; 4])> {
    let recipe = Arc::new(Recipe::with_params(task, task.levels().params(level))?);
    let (mut drawn, mut contested, mut wins) = (0, 0, [0; 4]);
    for seeds in (FIRST..FIRST + MOST).collect::<Vec<_>>().chunks(CELL) {
        let found: anyhow::Result<Vec<Option<[bool; 4]>>> =
            seeds.par_iter().map(|&seed| scenario(task, &recipe, seed)).collect();
        for outcome in found? {
            drawn += 1;
            if let Some(won) = outcome {
                contested += 1;
                wins.iter_mut().zip(won).for_each(|(wins, won)| *wins += usize::from(won));
            }
            if contested == CELL {
                return Ok(((drawn, contested), wins));
            }
        }
    }
    Ok(((drawn, contested), wins))
}

/// Who wins a scenario; none where it is not contested.
fn scenario(
    task: &'static dyn TaskSpec,
    recipe: &Arc<Recipe>,
    seed: u64,
) -> anyhow::Result<Option<[bool; 4]>> {
    let scenario = Scenario::new(Arc::clone(recipe), Seed::user(seed)?);
    let admission = admit(&scenario);
    let Some(bracket) = admission.bracket.filter(|_| admission.contested) else { return Ok(None) };
    let mut won = [false; 4];
    for (won, name) in won.iter_mut().zip(POLICIES) {
        let mut policy = task.policy(name, &scenario, seed).context(name)?;
        let (flown, _) = fly(&scenario, &mut *policy)?;
        *won = success(&scenario, SuccessRule::Task, &bracket, &flown);
    }
    Ok(Some(won))
}
