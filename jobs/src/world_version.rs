//! Version of everything that decides the result of a job.

use std::sync::OnceLock;

use env_core::admission::admit;
use env_core::{Recipe, Scenario, ScenarioError, SeedSpace};

use crate::episode_batch::{EpisodeBatch, LoggedEpisode};
use crate::{critique, seeds};

/// Version of the form of payloads and results. It changes whenever bytes change their meaning.
pub const FORMAT: u16 = 1;

/// Levels of each task whose scenarios are computed.
const PROBED_LEVELS: [usize; 2] = [0, 5];
/// Time limit of these scenarios in seconds, where the levels have a longer one: whole episodes of tasking take seconds to plan.
const MAX_PROBED_TIME_S: f64 = 3000.0;

/// Returns the version of the worlds, planners and critiques of this program on this machine.
///
/// It is the package's version with a digest of computed results: brackets and critiques of some scenarios of each task. Programs that
/// compute other bits, because of their source, their compiler or their processor, have different versions. The first call computes
/// for a moment; later ones are free.
#[must_use]
pub fn world_version() -> &'static str {
    static VERSION: OnceLock<String> = OnceLock::new();
    VERSION.get_or_init(|| {
        let digest = probe_digest().to_hex();
        format!("{}-{FORMAT}-{}", env!("CARGO_PKG_VERSION"), &digest.as_str()[..12])
    })
}

/// Digest of computed results.
fn probe_digest() -> blake3::Hash {
    let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 world version");
    for scenario in probed_scenarios() {
        let task = scenario.task();
        hasher.update(task.id().as_bytes()).update(task.world().as_bytes());
        add_scenario(&mut hasher, &scenario);
    }
    hasher.finalize()
}

/// Scenarios of all tasks, whose results are computed.
fn probed_scenarios() -> impl Iterator<Item = Scenario> {
    env_core::tasks().enumerate().flat_map(|(number, task)| {
        PROBED_LEVELS.into_iter().filter_map(move |level| {
            let recipe = Recipe::at_level(task, level).and_then(shortened).ok()?;
            Some(Scenario::new(recipe, seeds::seed_of(SeedSpace::Training, 1, number as u64, level as u64)))
        })
    })
}

/// Limits the time of a recipe.
fn shortened(recipe: Recipe) -> Result<Recipe, ScenarioError> {
    let is_long = recipe.param("time_limit_s").is_some_and(|limit| limit > MAX_PROBED_TIME_S);
    if is_long { recipe.with_param("time_limit_s", MAX_PROBED_TIME_S) } else { Ok(recipe) }
}

fn add_scenario(hasher: &mut blake3::Hasher, scenario: &Scenario) {
    hasher.update(&scenario.id().0);
    let admission = admit(scenario);
    hasher.update(&[u8::from(admission.solvable), u8::from(admission.contested)]);
    let Some(bracket) = admission.bracket else { return };
    hasher.update(&bracket.planner_version.to_le_bytes()).update(&bracket.floor.to_le_bytes());
    for outcome in bracket.panel.iter().chain([&bracket.reference]) {
        for value in [outcome.score, outcome.total_reward, outcome.fuel_used, outcome.goal.unwrap_or(-1.0)] {
            hasher.update(&value.to_le_bytes());
        }
    }
    hasher.update(&bracket.reference_plan.encode());
    let log = bracket.reference_plan.into();
    let batch = EpisodeBatch(vec![LoggedEpisode { scenario: scenario.clone(), log }]);
    if let Ok(bytes) = critique::criticise(&batch).encode() {
        hasher.update(&bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenarios_of_every_task_are_computed() {
        let tasks: Vec<_> = probed_scenarios().map(|scenario| scenario.task().id()).collect();
        let expected: Vec<_> = env_core::tasks().flat_map(|task| [task.id(); 2]).collect();
        assert_eq!(tasks, expected);
    }
}
