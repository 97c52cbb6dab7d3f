//! Version of everything that decides the result of a job.

use std::sync::OnceLock;

use env_core::admission::admit;
use env_core::{Recipe, Scenario, SeedSpace};

use crate::episode_batch::{EpisodeBatch, LoggedEpisode};
use crate::{critique, seeds};

/// Version of the form of payloads and results. It changes whenever bytes change their meaning.
pub const FORMAT: u16 = 1;

/// Levels of each task whose scenarios are computed.
const PROBED_LEVELS: [usize; 2] = [0, 5];

/// Returns the version of the worlds, planners and critiques of this program on this machine.
///
/// It is the package's version with a digest of computed results: brackets and critiques of some scenarios of each task. Programs that
/// compute other bits, because of their source, their compiler or their processor, have different versions. The first call takes
/// about a second; later ones are free.
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
    for (number, task) in env_core::tasks().enumerate() {
        hasher.update(task.id().as_bytes()).update(task.world().as_bytes());
        for level in PROBED_LEVELS {
            let Ok(recipe) = Recipe::at_level(task, level) else { continue };
            let seed = seeds::seed_of(SeedSpace::Training, 1, number as u64, level as u64);
            add_scenario(&mut hasher, &Scenario::new(recipe, seed));
        }
    }
    hasher.finalize()
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
