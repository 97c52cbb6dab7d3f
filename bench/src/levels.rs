//! Difficulty of the levels: success of policies on contested scenarios, for the tables of `docs/worlds/`. It measures no speed and
//! runs only if it is named.

use std::sync::Arc;

use anyhow::Context;
use env_core::admission::{admit, is_success};
use env_core::rollout::roll_out;
use env_core::{Recipe, Scenario, Seed, SuccessRule, TaskSpec};
use rayon::prelude::*;

use crate::Row;

/// Contested scenarios of each task and level.
const CONTESTED: usize = 200;
/// The same of tasks whose brackets take tens of milliseconds.
const FEW_CONTESTED: usize = 40;
/// Scenarios that are drawn at most for each contested one.
const MAX_DRAWN_EACH: usize = 10;
/// First of the user seeds by default. Levels and policies of tasking were chosen on scenarios of these seeds.
pub(crate) const FIRST_SEED: u64 = 7_000_000;
const POLICIES: [&str; 4] = ["heuristic", "frozen", "blind", "hold"];

/// Measures all levels of the tasks whose names begin with a prefix.
pub(crate) fn measure(prefix: &str, first_seed: u64) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for task in env_core::tasks().filter(|task| task.id().starts_with(prefix)) {
        for level in 0..task.levels().len() {
            let result = measure_level(task, level, first_seed)?;
            let share = |wins: usize| wins as f64 / result.contested.max(1) as f64;
            let mean = |sum: f64| sum / result.contested.max(1) as f64;
            let shares: Vec<String> = POLICIES
                .iter()
                .zip(result.wins)
                .map(|(name, wins)| format!("{name} {:.2}", share(wins)))
                .collect();
            rows.push(Row {
                label: format!(
                    "{} L{level}, contested {:.2} of {} drawn, reference {:.2}, floor {:.2}",
                    task.id(),
                    result.contested as f64 / result.drawn as f64,
                    result.drawn,
                    mean(result.reference),
                    mean(result.floor)
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
    /// Sums over contested scenarios.
    reference: f64,
    floor: f64,
}

/// Results on a contested scenario.
struct ScenarioResult {
    wins: [bool; 4],
    reference: f64,
    floor: f64,
}

fn measure_level(task: &'static dyn TaskSpec, level: usize, first_seed: u64) -> anyhow::Result<LevelResult> {
    let recipe = Arc::new(Recipe::at_level(task, level)?);
    let mut result = LevelResult::default();
    let wanted = if task.world() == env_core::tasking::WORLD_ID { FEW_CONTESTED } else { CONTESTED };
    let seeds: Vec<u64> = (first_seed..).take(wanted * MAX_DRAWN_EACH).collect();
    for seeds in seeds.chunks(wanted) {
        let outcomes: anyhow::Result<Vec<Option<ScenarioResult>>> =
            seeds.par_iter().map(|&seed| scenario_result(task, &recipe, seed)).collect();
        for outcome in outcomes? {
            result.drawn += 1;
            if let Some(outcome) = outcome {
                result.contested += 1;
                result.reference += outcome.reference;
                result.floor += outcome.floor;
                result.wins.iter_mut().zip(outcome.wins).for_each(|(wins, won)| *wins += usize::from(won));
            }
            if result.contested == wanted {
                return Ok(result);
            }
        }
    }
    Ok(result)
}

/// Returns which policies succeed on a scenario, or `None` if it is not contested.
fn scenario_result(
    task: &'static dyn TaskSpec,
    recipe: &Arc<Recipe>,
    seed: u64,
) -> anyhow::Result<Option<ScenarioResult>> {
    let scenario = Scenario::new(Arc::clone(recipe), Seed::user(seed)?);
    let admission = admit(&scenario);
    let Some(bracket) = admission.bracket.filter(|_| admission.contested) else { return Ok(None) };
    let mut won = [false; 4];
    for (won, name) in won.iter_mut().zip(POLICIES) {
        let mut policy = task.policy(name, &scenario, seed).context(name)?;
        let flown = roll_out(&scenario, &mut *policy)?.outcome;
        *won = is_success(&scenario, SuccessRule::Task, &bracket, &flown);
    }
    Ok(Some(ScenarioResult { wins: won, reference: bracket.reference.score, floor: bracket.floor }))
}
