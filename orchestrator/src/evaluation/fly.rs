//! Built-in policies on a suite.

use env_core::rollout;
use rayon::prelude::*;

use super::flown::{Flown, Measures, measure};
use super::suite::{Entry, Suite};

/// A scenario that could not be flown.
#[derive(Debug, thiserror::Error)]
#[error("{policy} on scenario {scenario}: {source}")]
pub struct FlyError {
    policy: String,
    scenario: String,
    source: Box<dyn std::error::Error + Send + Sync>,
}

/// Flies a policy on every scenario: `rollouts` times where its actions are drawn, else once. `done` hears of each scenario.
///
/// # Errors
/// A scenario that cannot be flown by it.
pub fn fly(
    suite: &Suite,
    policy: &str,
    (seed, rollouts): (u64, u32),
    done: &(dyn Fn() + Sync),
) -> Result<Flown, FlyError> {
    let entries: Vec<&Entry> = suite.entries().collect();
    let chance = entries.iter().any(|entry| by_chance(entry, policy));
    let episodes = entries.into_par_iter().map(|entry| {
        let often = if by_chance(entry, policy) { rollouts } else { 1 };
        let flown = (0..often).map(|rollout| once(entry, policy, seed, rollout)).collect();
        done();
        flown
    });
    Ok(Flown { policy: policy.to_owned(), chance, episodes: episodes.collect::<Result<_, FlyError>>()? })
}

fn by_chance(entry: &Entry, policy: &str) -> bool {
    entry.scenario.task().policies().iter().any(|spec| spec.name == policy && spec.chance)
}

fn once(entry: &Entry, policy: &str, seed: u64, rollout: u32) -> Result<Measures, FlyError> {
    let scenario = &entry.scenario;
    let fault = |source: Box<dyn std::error::Error + Send + Sync>| FlyError {
        policy: policy.to_owned(),
        scenario: scenario.id().to_string(),
        source,
    };
    let seed = policy_seed(seed, policy, entry, rollout);
    let mut pilot = scenario.task().policy(policy, scenario, seed).map_err(|error| fault(error.into()))?;
    let (flown, _) = rollout::fly(scenario, &mut *pilot).map_err(|error| fault(error.into()))?;
    Ok(measure(entry, &flown))
}

/// A seed of its own for every (seed, policy, scenario, rollout).
fn policy_seed(seed: u64, policy: &str, entry: &Entry, rollout: u32) -> u64 {
    let mut hasher = blake3::Hasher::new_derive_key("sparring eval policy seed 1");
    hasher.update(&seed.to_le_bytes()).update(&rollout.to_le_bytes());
    hasher.update(&entry.scenario.id().0).update(policy.as_bytes());
    let mut word = [0; 8];
    word.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(word)
}
