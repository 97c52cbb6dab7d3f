//! Difficulty of the levels: success of policies on contested scenarios, for the tables of `docs/worlds/kessler.md` and
//! `docs/worlds/docking.md`. It measures no speed and runs only if it is named.

use std::sync::Arc;

use anyhow::Context;
use env_core::admission::{admit, is_success};
use env_core::rollout::roll_out;
use env_core::{Recipe, Scenario, Seed, SuccessRule, TaskSpec};
use rayon::prelude::*;

use crate::Row;

/// Contested scenarios of each task and level.
const CONTESTED: usize = 200;
/// Largest number of scenarios that are drawn for them.
const MAX_DRAWN: u64 = 2000;
/// First of the user seeds.
const FIRST_SEED: u64 = 7_000_000;
const POLICIES: [&str; 4] = ["heuristic", "frozen", "blind", "hold"];

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for task in env_core::tasks() {
        for level in 0..task.levels().len() {
            let result = measure_level(task, level)?;
            let share = |wins: usize| wins as f64 / CONTESTED.min(result.contested).max(1) as f64;
            let shares: Vec<String> = POLICIES
                .iter()
                .zip(result.wins)
                .map(|(name, wins)| format!("{name} {:.2}", share(wins)))
                .collect();
            rows.push(Row {
                label: format!(
                    "{} L{level}, contested {:.2} of {} drawn",
                    task.id(),
                    result.contested as f64 / result.drawn as f64,
                    result.drawn
                ),
                measured: shares.join(", "),
                goal: String::new(),
                ratio: None,
            });
        }
    }
    Ok(rows)
}

/// Successes of the policies at one level of a task.
#[derive(Default)]
struct LevelResult {
    drawn: usize,
    contested: usize,
    /// Number of contested scenarios on which each policy succeeds.
    wins: [usize; 4],
}

fn measure_level(task: &'static dyn TaskSpec, level: usize) -> anyhow::Result<LevelResult> {
    let recipe = Arc::new(Recipe::at_level(task, level)?);
    let mut result = LevelResult::default();
    for seeds in (FIRST_SEED..FIRST_SEED + MAX_DRAWN).collect::<Vec<_>>().chunks(CONTESTED) {
        let outcomes: anyhow::Result<Vec<Option<[bool; 4]>>> =
            seeds.par_iter().map(|&seed| policy_successes(task, &recipe, seed)).collect();
        for outcome in outcomes? {
            result.drawn += 1;
            if let Some(won) = outcome {
                result.contested += 1;
                result.wins.iter_mut().zip(won).for_each(|(wins, won)| *wins += usize::from(won));
            }
            if result.contested == CONTESTED {
                return Ok(result);
            }
        }
    }
    Ok(result)
}

/// Returns which policies succeed on a scenario, or `None` if it is not contested.
fn policy_successes(
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
        let flown = roll_out(&scenario, &mut *policy)?.outcome;
        *won = is_success(&scenario, SuccessRule::Task, &bracket, &flown);
    }
    Ok(Some(won))
}
